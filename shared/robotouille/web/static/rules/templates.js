/** Templates with names in braces, as Python's formatter reads them. Formats are invalid. */

/**
 * Return a template's texts and fields in turn, beginning with a text; null if it is malformed.
 * @param {string} template
 */
function parts(template) {
  const found = [""];
  for (let i = 0; i < template.length; i++) {
    const letter = template[i];
    if (letter === template[i + 1] && (letter === "{" || letter === "}")) {
      found[found.length - 1] += letter;
      i++;
    } else if (letter === "}") {
      return null;
    } else if (letter === "{") {
      const end = template.indexOf("}", i);
      const field = template.slice(i + 1, end);
      if (end < 0 || field.includes("{")) return null;
      found.push(field, "");
      i = end;
    } else {
      found[found.length - 1] += letter;
    }
  }
  return found;
}

/** Return the fields of a template in order; none if it is malformed. @param {string} template */
export function fields(template) {
  return (parts(template) ?? []).filter((field, i) => i % 2 && field);
}

/**
 * Fill a template. Return an empty string if it names unknown fields, or has formats.
 * @param {string} template @param {Map<string, string> | Record<string, string>} words
 * @param {string[]} called Values of `{0}`, `{1}` and so on.
 */
export function filled(template, words, called = []) {
  const known = words instanceof Map ? words : new Map(Object.entries(words));
  const found = parts(template);
  if (!found) return "";
  for (let i = 1; i < found.length; i += 2) {
    const field = found[i] === "" ? String((i - 1) / 2) : found[i];
    const value = /^\d+$/.test(field) ? called[Number(field)] : known.get(field);
    if (value === undefined) return "";
    found[i] = value;
  }
  return found.join("");
}

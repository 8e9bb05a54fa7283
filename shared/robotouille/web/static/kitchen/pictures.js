/** Pictures as URLs and as canvases of a size: files of a look, or generated tiles. */

/** @typedef {import("./look.js").Look} Look */
/** @typedef {import("./look.js").Appearance} Appearance */

export const INK = "#3b2f2f";
export const PAPER = "#fffaf0";
/** Seat colours. They differ in lightness, which colour blindness leaves intact. */
export const SEATS = [
  "#e2503e", "#68bbf5", "#c7d93a", "#703eb8", "#4ab2b2", "#f0ece4", "#464650", "#3c5082",
];
/** Pixels of all cached canvases together, at 4 bytes each. One frame needs less. */
const MAX_PIXELS = 32_000_000;
const MAX_SIDE = 2048;

/** @param {string} svg */
const svgURL = (svg) => `data:image/svg+xml;charset=utf-8,${encodeURIComponent(svg)}`;

/**
 * Return the URL of an appearance's picture, for an `<img>`.
 * @param {Look} look @param {Appearance} appearance
 */
export function pictureURL(look, appearance) {
  return fileURL(look, appearance.asset) ?? svgURL(generated(appearance));
}

/** @param {Look} look @param {string | null | undefined} file */
function fileURL(look, file) {
  const content = file ? look.pictures.get(file) : undefined;
  if (content === undefined) return null;
  return content.startsWith("data:") ? content : svgURL(content);
}

/** @param {string} url */
async function decoded(url) {
  const image = new Image();
  image.src = url;
  await image.decode();
  return image;
}

/** Return a text as it may stand in an SVG. @param {string} text */
function escaped(text) {
  return text.replace(/[^\p{L}\p{N} _-]/gu, (letter) => `&#${letter.codePointAt(0)};`);
}

/**
 * Return a tile for a kind without a picture: its name on a bench, a block or a figure.
 * @param {Appearance} appearance
 */
function generated({ kind, role, words, facing }) {
  // FNV-1a: the same colour for a kind on every machine.
  let hash = 0x811c9dc5;
  for (const letter of kind) hash = Math.imul(hash ^ (letter.codePointAt(0) ?? 0), 0x01000193);
  const hue = (hash >>> 4) % 360;
  const box = (/** @type {number[]} */ [x, y, width, height, radius, light], line = 3) =>
    `<rect x="${x}" y="${y}" width="${width}" height="${height}" rx="${radius}" ` +
    `fill="hsl(${hue} 40% ${light}%)" stroke="${INK}" stroke-width="${line}"/>`;
  const lines = [kind, ...words.split(" ").slice(0, 2)].filter(Boolean);
  let [middle, size, room] = [52, lines.length > 1 ? 14 : 17, 76];
  let shapes = box([9, 19, 82, 66, role === "container" ? 30 : 14, 68]);
  if (role === "station") {
    shapes = box([2, 11, 96, 87, 5, 42]) + box([2, 2, 96, 72, 5, 74]);
    [middle, size, room] = [87, 13 / Math.sqrt(lines.length), 88];
  } else if (role === "player") {
    const shift = facing === "left" ? -10 : facing === "right" ? 10 : 0;
    shapes = box([31, 51, 38, 42, 14, 48]) + box([25, 11, 50, 48, 24, 66]);
    for (const x of facing === "back" ? [] : [41 + shift, 59 + shift]) {
      shapes += `<ellipse cx="${x}" cy="35" rx="5" ry="7" fill="${PAPER}"/>`;
      shapes += `<ellipse cx="${x}" cy="35" rx="2.5" ry="3.5" fill="${INK}"/>`;
    }
    [middle, size, room] = [76, 11, 36];
  }
  if (role === "station") shapes += box([7, 6, 86, 5, 2, 88], 0);
  else if (role !== "player") shapes += box([20, 25, 60, 6, 3, 84], 0);
  const ink = role === "station" ? PAPER : INK;
  const text = lines.map((line, i) => {
    const fit = Math.min(size, (1.7 * room) / Math.max(1, line.length));
    const y = middle + (i - (lines.length - 1) / 2) * size + fit * 0.35;
    return `<text x="50" y="${y}" font-size="${fit}" fill="${ink}">${escaped(line)}</text>`;
  });
  const style = `text-anchor="middle" font-family="sans-serif" font-weight="bold"`;
  return (
    `<svg xmlns="http://www.w3.org/2000/svg" width="100" height="100" viewBox="0 0 100 100">` +
    `${shapes}<g ${style}>${text.join("")}</g></svg>`
  );
}

/**
 * Return a regular polygon in a unit square; `dent` pushes every other corner in.
 * @param {number} corners
 * @param {{turn?: number, dent?: number, reach?: number, down?: number}} shape
 * @returns {[number, number][]}
 */
function regular(corners, { turn = 0, dent = 1, reach = 0.46, down = 0 }) {
  const count = dent === 1 ? corners : corners * 2;
  return Array.from({ length: count }, (_, i) => {
    const angle = 2 * Math.PI * (i / count + turn);
    const far = reach * (i % 2 ? dent : 1);
    return [0.5 + far * Math.sin(angle), 0.5 + down - far * Math.cos(angle)];
  });
}

const ARM = [0.08, 0.35, 0.65, 0.92];
/** Corners of the seats' badges. A colour and a shape each: either one tells the seats apart. */
/** @type {[number, number][][]} */
const SHAPES = [
  regular(40, {}),
  regular(4, { turn: 0.125, reach: 0.56 }),
  regular(3, { reach: 0.54, down: 0.1 }),
  regular(5, { dent: 0.48, reach: 0.52, down: 0.03 }),
  [[0.5, 0], [0.86, 0.5], [0.5, 1], [0.14, 0.5]],
  [...["10", "20", "21", "31", "32", "22", "23", "13", "12", "02", "01", "11"]].map(
    (at) => /** @type {[number, number]} */ ([ARM[Number(at[0])], ARM[Number(at[1])]]),
  ),
  [[0.08, 0.06], [0.92, 0.06], [0.62, 0.5], [0.92, 0.94], [0.08, 0.94], [0.38, 0.5]],
  [[0.08, 0.3], [0.5, 0.3], [0.5, 0.05], [0.95, 0.5], [0.5, 0.95], [0.5, 0.7], [0.08, 0.7]],
];

/** Return the URL of a seat's badge, for an `<img>`. @param {number} seat @param {string} colour */
export function badgeURL(seat, colour = SEATS[seat % SEATS.length]) {
  const layers = [[1, INK], [0.84, PAPER], [0.64, colour]].map(([scale, ink]) => {
    const points = SHAPES[seat % SHAPES.length].map((corner) =>
      corner.map((value) => (50 + (value - 0.5) * Number(scale) * 100).toFixed(1)).join(","),
    );
    return `<polygon points="${points.join(" ")}" fill="${ink}"/>`;
  });
  const size = `width="100" height="100" viewBox="0 0 100 100"`;
  return svgURL(`<svg xmlns="http://www.w3.org/2000/svg" ${size}>${layers.join("")}</svg>`);
}

/** Pictures of a look, decoded once and drawn once for each size. */
export class Sprites {
  /** @param {Look} look @param {() => void} changed Called when a picture has been decoded. */
  constructor(look, changed) {
    this.look = look;
    this.changed = changed;
    /** @type {Map<string, HTMLImageElement | "broken" | null>} Null while they are decoded. */
    this.images = new Map();
    /** @type {Map<string, HTMLCanvasElement>} */
    this.cache = new Map();
    this.pixels = 0;
    /** @type {Set<string>} Pictures that were asked for before they were decoded. */
    this.missed = new Set();
    /** Number of missed pictures decoded so far. A frame then looks different. */
    this.revision = 0;
  }

  /** Decode pictures of the look. @param {Iterable<string>} files */
  async load(files) {
    const known = [...files].filter((file) => this.look.pictures.has(file));
    await Promise.all(known.map((file) => this.decode(file, fileURL(this.look, file) ?? "")));
  }

  /** @param {string} key @param {string} url */
  async decode(key, url) {
    if (this.images.has(key)) return;
    this.images.set(key, null);
    this.images.set(key, await decoded(url).catch(() => "broken"));
    if (!this.missed.delete(key)) return;
    this.revision += 1;
    this.changed();
  }

  /**
   * Return a file's picture as a square of a size in pixels, or null.
   * @param {string | null | undefined} file @param {number} size
   */
  file(file, size) {
    if (!file || !this.look.pictures.has(file)) return null;
    return this.drawn(file, () => fileURL(this.look, file) ?? "", size);
  }

  /**
   * Return an object's picture as a square of a size in pixels; null until it is decoded.
   * @param {Appearance} appearance @param {number} size
   */
  of(appearance, size) {
    const { asset, kind, role, words, facing } = appearance;
    if (asset && this.look.pictures.has(asset) && this.images.get(asset) !== "broken") {
      return this.file(asset, size);
    }
    const key = JSON.stringify([kind, role, words, facing]);
    return this.drawn(key, () => svgURL(generated(appearance)), size);
  }

  /**
   * Return a picture as a square of a size; null until it is decoded.
   * @param {string} key @param {() => string} url Called once, because URLs of pictures are long.
   * @param {number} size
   */
  drawn(key, url, size) {
    const side = Math.max(1, Math.min(Math.round(size), MAX_SIDE));
    const image = this.images.get(key);
    if (image === undefined) void this.decode(key, url());
    if (!image) this.missed.add(key);
    if (!image || image === "broken") return null;
    return this.kept(`${side} ${key}`, side, side, (context) => {
      context.imageSmoothingQuality = "high";
      context.drawImage(image, 0, 0, side, side);
    });
  }

  /**
   * Return a canvas that is drawn once.
   * @param {string} key @param {number} width @param {number} height
   * @param {(context: CanvasRenderingContext2D) => void} draw
   */
  kept(key, width, height, draw) {
    const known = this.cache.get(key);
    if (known) return known;
    // Simpler than tracking use, and rare: one frame needs less than a full cache.
    if (this.pixels + width * height > MAX_PIXELS) {
      this.cache.clear();
      this.pixels = 0;
    }
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = height;
    draw(/** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d")));
    this.cache.set(key, canvas);
    this.pixels += width * height;
    return canvas;
  }
}

// Script of the page itself: unpacks the modules, then the data, and starts the first module.
(async () => {
  const byId = (/** @type {string} */ id) =>
    /** @type {HTMLElement} */ (document.getElementById(id));
  const show = (/** @type {string} */ text) => {
    byId("message").hidden = false;
    byId("message").textContent = text;
  };
  if (!globalThis.DecompressionStream || !HTMLScriptElement.supports?.("importmap")) {
    show("This browser is too old to show the recording. Chrome 89, Edge 89, Firefox 113, " +
      "Safari 16.4 and later versions can.");
    return;
  }
  const unpacked = (/** @type {string} */ id) => {
    const text = atob((byId(id).textContent ?? "").replace(/\s/g, ""));
    const bytes = Uint8Array.from(text, (letter) => letter.charCodeAt(0));
    const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  };
  try {
    const imports = document.createElement("script");
    imports.type = "importmap";
    imports.textContent = await unpacked("modules");
    document.head.append(imports);
    const entry = "robotouille/{entry}";
    const [{ start }, data] = await Promise.all([import(entry), unpacked("data")]);
    await start(JSON.parse(data));
  } catch (error) {
    show(`The recording cannot be shown: ${error}`);
  }
})();

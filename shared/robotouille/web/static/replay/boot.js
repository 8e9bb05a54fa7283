// Script of the page itself: unpacks the modules and the data, and starts the first module.
(async () => {
  const byId = (/** @type {string} */ id) =>
    /** @type {HTMLElement} */ (document.getElementById(id));
  const show = (/** @type {string} */ text) => {
    byId("message").hidden = false;
    byId("message").textContent = text;
  };
  if (!globalThis.DecompressionStream) {
    show("This browser is too old to show the recording. Chrome 104, Edge 104, Firefox 113, " +
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
    const [source, data] = await Promise.all([unpacked("modules"), unpacked("data")]);
    const script = `data:text/javascript;charset=utf-8,${encodeURIComponent(source)}`;
    const { default: { start } } = await import(script);
    await start(JSON.parse(data));
  } catch (error) {
    show(`The recording cannot be shown: ${error}`);
  }
})();

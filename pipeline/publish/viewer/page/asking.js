// Questions to the program behind a page, and the images that it answers.
"use strict";
(function (viewer) {
  // A question: JSON there; a JSON header and bytes back, unless a signal ends the waiting.
  async function ask(path, question, signal) {
    const response = await fetch(`${path}${location.search}`, {
      method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question), signal,
    }).catch((error) => {
      throw signal?.aborted ? error : new Error("The program does not answer. Is it still running?");
    });
    if (!response.ok) throw new Error((await response.json()).error);
    const bytes = await response.arrayBuffer();
    const length = new DataView(bytes).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
    return { header, payload: bytes.slice(4 + length) };
  }

  // Shows (height, width, 3) bytes on a canvas, which takes their size.
  function paint(context, height, width, rgb) {
    const { canvas } = context;
    const image = new ImageData(width, height);
    image.data.fill(255);
    for (let pixel = 0, at = 0; pixel < 3 * height * width; pixel += 3, at += 4) {
      image.data[at] = rgb[pixel];
      image.data[at + 1] = rgb[pixel + 1];
      image.data[at + 2] = rgb[pixel + 2];
    }
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    context.putImageData(image, 0, 0);
  }

  viewer.ask = ask;
  viewer.paint = paint;
})((self.objectfolderViewer ??= {}));

// Questions to the program behind a page, and the images that it answers.

const SILENT = "The program does not answer. Is it still running?";

// A question: JSON there; an answer back, unless a signal ends the waiting.
export async function ask(path, question, signal) {
  return unpacked(await (await sent(path, question, signal)).arrayBuffer());
}

// One question, whose answers come one after the other on the same connection.
export async function* answers(path, question) {
  const reader = (await sent(path, question)).body.getReader();
  let bytes = new Uint8Array();
  for (;;) {
    const { value, done } = await reader.read().catch(() => ({ done: true }));
    if (done) throw new Error(SILENT);
    const joined = new Uint8Array(bytes.length + value.length);
    joined.set(bytes);
    joined.set(value, bytes.length);
    bytes = joined;
    for (let end; bytes.length >= 4 && bytes.length >= (end = 4 + lengthIn(bytes.buffer)); ) {
      yield unpacked(bytes.buffer.slice(4, end));
      bytes = bytes.slice(end);
    }
  }
}

async function sent(path, question, signal) {
  const response = await fetch(`${path}${location.search}`, {
    method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(question), signal,
  }).catch((error) => {
    throw signal?.aborted ? error : new Error(SILENT);
  });
  if (!response.ok) throw new Error((await response.json()).error);
  return response;
}

const lengthIn = (bytes) => new DataView(bytes).getUint32(0, true);

// A JSON header after its length, and bytes.
function unpacked(bytes) {
  const length = lengthIn(bytes);
  const header = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  return { header, payload: bytes.slice(4 + length) };
}

// Shows (height, width, 3) bytes on a canvas, which takes their size.
export function paint(context, height, width, rgb) {
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

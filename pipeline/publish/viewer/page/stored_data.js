// The arrays of a data script: base64, deflated, bytes in planes; see `pipeline/publish/viewer/bake.py`.

const ARRAYS = { Int8Array, Uint8Array, Int16Array, Int32Array };

async function inflated(text) {
  const packed = Uint8Array.from(atob(text), (character) => character.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

function unplaned(bytes, { type, shape, offset }) {
  const kind = ARRAYS[type];
  const count = shape.reduce((product, side) => product * side, 1);
  const width = kind.BYTES_PER_ELEMENT;
  const ordered = new Uint8Array(count * width);
  for (let plane = 0; plane < width; plane += 1) {
    const start = offset + plane * count;
    for (let index = 0; index < count; index += 1) ordered[index * width + plane] = bytes[start + index];
  }
  return new kind(ordered.buffer);
}

// Running sums over `stride` interleaved columns, in place.
function integrated(values, stride) {
  for (let index = stride; index < values.length; index += 1) values[index] += values[index - stride];
  return values;
}

export async function storedArrays(stored) {
  const bytes = await inflated(stored.data);
  const arrays = {};
  for (const [name, described] of Object.entries(stored.header.arrays)) {
    arrays[name] = unplaned(bytes, described);
  }
  integrated(arrays.positions, 3);
  integrated(arrays.faces, 1);
  integrated(arrays.colours, 3);
  return arrays;
}

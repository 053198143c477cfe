"use strict";
// Unpacks the arrays of `packed_arrays.py`.

function bytesOfBase64(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const binary = atob(text), bytes = new Uint8Array(binary.length);
  for (let i = 0; i < bytes.length; i++) bytes[i] = binary.charCodeAt(i);
  return bytes;
}

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}

/** The columns of a packed array, each a Float32Array. */
function unpackColumns(bytes, start, layout) {
  const { rows, columns, planes, step, signed, delta, exact } = layout;
  const result = [];
  for (let c = 0; c < columns; c++) {
    const bits = new Uint32Array(rows);
    for (let p = 0; p < planes; p++) {
      const from = start + (c * planes + p) * rows;
      for (let i = 0; i < rows; i++) bits[i] |= bytes[from + i] << (8 * p);
    }
    if (exact) {
      result.push(new Float32Array(bits.buffer));
      continue;
    }
    const numbers = new Float32Array(rows);
    let sum = 0;
    for (let i = 0; i < rows; i++) {
      const u = bits[i], number = signed ? (u & 1 ? -((u >>> 1) + 1) : u >>> 1) : u;
      sum = delta ? sum + number : number;
      numbers[i] = sum * step;
    }
    result.push(numbers);
  }
  return result;
}

/** All arrays by name: `columns(name)`, and `rows(name)` for a row-major Float32Array. */
async function unpack(base64, layouts) {
  const bytes = await inflate(bytesOfBase64(base64)), places = new Map();
  let start = 0;
  for (const layout of layouts) {
    places.set(layout.name, { start, layout });
    start += layout.rows * layout.columns * layout.planes;
  }
  const columns = (name) => unpackColumns(bytes, places.get(name).start, places.get(name).layout);
  const rows = (name) => {
    const parts = columns(name), count = parts.length;
    if (count === 1) return parts[0];
    const result = new Float32Array(count * places.get(name).layout.rows);
    parts.forEach((part, c) => { for (let i = 0; i < part.length; i++) result[i * count + c] = part[i]; });
    return result;
  };
  return { columns, rows, has: (name) => places.has(name) };
}

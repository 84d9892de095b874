// A message of the gateway as slots whose typed arrays look into it (client/watch/frame.h). Pure.

const kMagic = 0x544c5454;
const kTypes = { uint8: Uint8Array, float32: Float32Array, float64: Float64Array };
export const channels = ['trace', 'status', 'scene', 'map', 'tactile', 'windows', 'timeline', 'b_mode', 'surface'];

const padded = (bytes) => (bytes + 7) & ~7;

// Throws RangeError for what is no whole frame.
export function decode(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 16 || view.getUint32(0, true) !== kMagic) throw new RangeError('no frame');
  const frame = { number: view.getUint32(4, true), slots: {} };
  const count = view.getUint32(8, true);
  let at = 16;
  for (let n = 0; n < count; ++n) {
    if (at + 16 > buffer.byteLength) throw new RangeError('the frame is cut short');
    const channel = view.getUint32(at, true);
    const json = view.getUint32(at + 4, true);
    const data = view.getUint32(at + 8, true);
    const jsonAt = at + 16;
    const dataAt = jsonAt + padded(json);
    at = dataAt + padded(data);
    if (at > buffer.byteLength) throw new RangeError('the frame is cut short');
    const slot = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, jsonAt, json)));
    for (const array of slot.arrays ?? []) {
      const Type = kTypes[array.type];
      const length = array.shape.reduce((product, extent) => product * extent, 1);
      if (!Type || array.at + length * Type.BYTES_PER_ELEMENT > data) throw new RangeError('an array beyond its slot');
      array.values = new Type(buffer, dataAt + array.at, length);
      if (!(array.name in slot)) slot[array.name] = array;
    }
    if (channel < channels.length) frame.slots[channels[channel]] = slot;
  }
  return frame;
}

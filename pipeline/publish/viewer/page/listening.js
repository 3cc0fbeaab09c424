// Sounds played as they are, times one factor for the object; nothing is normalised strike by strike.

const FULL_SCALE = 32767;
let context = null;

// One for the page; browsers let it run after the first click or key.
export function audioContext() {
  context ??= new AudioContext({ latencyHint: "interactive" });
  return context;
}

// Starts `samples` (m/s) now; returns what was played, by what factor, and whether it had to be turned down.
export function play(samples, sampleRate, gain) {
  const output = audioContext();
  if (output.state === "suspended") output.resume();
  let peak = 0;
  for (const value of samples) peak = Math.max(peak, Math.abs(value));
  const played = Math.min(gain, peak > 0 ? 0.98 / peak : gain);
  if (!samples.length) return { played, peak, quieter: false };
  const buffer = output.createBuffer(1, samples.length, sampleRate);
  buffer.copyToChannel(samples, 0);
  const source = new AudioBufferSourceNode(output, { buffer });
  const volume = new GainNode(output, { gain: played });
  source.connect(volume).connect(output.destination);
  source.start();
  return { played, peak, quieter: played < gain, buffer };
}

// Samples times a gain as a file of 16 bits, one channel.
export function wavOf(samples, rate, gain = 1) {
  const bytes = 2 * samples.length;
  const wav = new DataView(new ArrayBuffer(44 + bytes));
  // "RIFF", "WAVE", "fmt ", one channel of PCM, "data".
  const head = [0x46464952, 36 + bytes, 0x45564157, 0x20746d66, 16, 0x10001, rate, 2 * rate, 0x100002, 0x61746164, bytes];
  head.forEach((word, index) => wav.setUint32(4 * index, word, true));
  samples.forEach((value, index) => wav.setInt16(44 + 2 * index, Math.round(FULL_SCALE * gain * value), true));
  return new Blob([wav.buffer], { type: "audio/wav" });
}

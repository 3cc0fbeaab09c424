// Sounds played as they are, times one factor for the object; nothing is normalised strike by strike.
"use strict";
(function (viewer) {
  const FULL_SCALE = 32767;
  let context = null;

  // One for the page; browsers let it run after the first click or key.
  function audioContext() {
    context ??= new AudioContext({ latencyHint: "interactive" });
    return context;
  }

  // Starts `samples` (m/s) now; returns what was played, by what factor, and whether it had to be turned down.
  function play(samples, sampleRate, gain) {
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
    [viewer.lastBuffer, viewer.lastGain] = [buffer, played];
    return { played, peak, quieter: played < gain };
  }

  // What was played last, as it was heard: 16 bits, one channel.
  function lastWav() {
    const { lastBuffer, lastGain } = viewer;
    const samples = lastBuffer.getChannelData(0);
    const wav = new DataView(new ArrayBuffer(44 + 2 * samples.length));
    const text = (at, letters) => [...letters].forEach((letter, index) => wav.setUint8(at + index, letter.charCodeAt(0)));
    const rate = Math.round(lastBuffer.sampleRate);
    text(0, "RIFF");
    wav.setUint32(4, 36 + 2 * samples.length, true);
    text(8, "WAVEfmt ");
    [[16, 4], [1, 2], [1, 2], [rate, 4], [2 * rate, 4], [2, 2], [16, 2]].reduce((at, [value, bytes]) => {
      if (bytes === 4) wav.setUint32(at, value, true);
      else wav.setUint16(at, value, true);
      return at + bytes;
    }, 16);
    text(36, "data");
    wav.setUint32(40, 2 * samples.length, true);
    samples.forEach((value, index) => wav.setInt16(44 + 2 * index, Math.round(FULL_SCALE * lastGain * value), true));
    return new Blob([wav.buffer], { type: "audio/wav" });
  }

  viewer.lastWav = lastWav;
  viewer.audioContext = audioContext;
  viewer.play = play;
})((window.objectfolderViewer ??= {}));

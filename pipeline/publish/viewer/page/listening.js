// Sounds played as they are, times one factor for the object; nothing is normalised strike by strike.
"use strict";
(function (viewer) {
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
    viewer.lastBuffer = buffer;
    return { played, peak, quieter: played < gain };
  }

  viewer.audioContext = audioContext;
  viewer.play = play;
})((window.objectfolderViewer ??= {}));

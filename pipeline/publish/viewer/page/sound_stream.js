// Sound that arrives in blocks, played one after the other without a seam.
"use strict";
(function (viewer) {
  // Played so long after it arrived: what a busy machine may be late. More than `MOST_S` ahead is left out.
  const BEHIND_S = 0.12;
  const MOST_S = 0.5;

  class SoundStream {
    // At `rate` hertz; the browser's device takes what it gets, so that blocks meet without resampling.
    constructor(rate, gain) {
      this.context = new AudioContext({ sampleRate: rate, latencyHint: "interactive" });
      this.volume = new GainNode(this.context, { gain });
      this.volume.connect(this.context.destination);
      Object.assign(this, { next: 0, peak: 0, underruns: 0 });
    }

    // Browsers let sound begin after a click or a key.
    resume() {
      if (this.context.state === "suspended") this.context.resume();
    }

    // Plays pascals; without a device, or before a click, they are dropped and the world goes on.
    push(pascals) {
      for (const value of pascals) this.peak = Math.max(this.peak, Math.abs(value));
      const now = this.context.currentTime;
      if (this.context.state !== "running" || !pascals.length || this.next > now + MOST_S) return;
      if (this.next < now) {
        if (this.next) this.underruns += 1;
        this.next = now + BEHIND_S;
      }
      const buffer = this.context.createBuffer(1, pascals.length, this.context.sampleRate);
      buffer.copyToChannel(pascals, 0);
      const source = new AudioBufferSourceNode(this.context, { buffer });
      source.connect(this.volume);
      source.start(this.next);
      this.next += buffer.duration;
    }
  }

  viewer.SoundStream = SoundStream;
})((window.objectfolderViewer ??= {}));

// Plays blocks of sound that arrive, one after the other without a seam, in the thread of the audio device.

// Sound waits so long at first, and longer after each gap: what a busy machine may be late. Seconds.
const FIRST_S = 0.12;
const LONGER_S = 0.03;
const LONGEST_S = 0.5;
// What waited longer than that for a second is left out, faded over so many samples.
const FADE = 512;

class SoundPlayer extends AudioWorkletProcessor {
  constructor() {
    super();
    Object.assign(this, { blocks: [], waiting: 0, behind: Math.round(FIRST_S * sampleRate), playing: false });
    Object.assign(this, { underruns: 0, skips: 0 });
    // The page sends a port, on which the sound comes.
    this.port.onmessage = ({ data }) => {
      data.onmessage = (block) => this.push(block.data);
    };
    this.tell();
  }

  tell() {
    const { underruns, skips, behind } = this;
    this.port.postMessage({ underruns, skips, behind: behind / sampleRate });
  }

  // A device that was lost plays nothing: what comes then is dropped.
  push(pascals) {
    if (this.waiting > 2 * sampleRate) return;
    this.blocks.push(pascals);
    this.waiting += pascals.length;
  }

  take(count) {
    const taken = new Float32Array(count);
    for (let at = 0; at < count; ) {
      const [first] = this.blocks;
      const part = first.subarray(0, count - at);
      taken.set(part, at);
      at += part.length;
      if (part.length === first.length) this.blocks.shift();
      else this.blocks[0] = first.subarray(part.length);
    }
    this.waiting -= count;
    return taken;
  }

  skip(count) {
    const before = this.take(FADE);
    this.take(count - FADE);
    this.blocks.unshift(this.take(FADE).map((after, at) => before[at] + ((after - before[at]) * at) / FADE));
    this.waiting += FADE;
    this.skips += 1;
    this.tell();
  }

  watch() {
    Object.assign(this, { least: Infinity, until: currentFrame + sampleRate });
  }

  process(_, [[heard]]) {
    if (this.playing && this.waiting < heard.length) {
      this.playing = false;
      this.underruns += 1;
      this.behind = Math.round(Math.min(this.behind + LONGER_S * sampleRate, LONGEST_S * sampleRate));
      this.tell();
    }
    if (!this.playing) {
      if (this.waiting < this.behind) return true;
      this.playing = true;
      this.watch();
    }
    heard.set(this.take(heard.length));
    this.least = Math.min(this.least, this.waiting);
    if (currentFrame >= this.until) {
      if (this.least > this.behind + FADE) this.skip(this.least - this.behind);
      this.watch();
    }
    return true;
  }
}

registerProcessor("sound-player", SoundPlayer);

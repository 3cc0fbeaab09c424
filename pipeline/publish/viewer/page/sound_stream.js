// Sound that arrives in blocks: asked for in a worker, played in the thread of the audio device.

export class SoundStream {
  // At `rate` hertz; the browser's device takes what it gets, so that blocks meet without resampling.
  constructor(rate, gain) {
    this.context = new AudioContext({ sampleRate: rate, latencyHint: "interactive" });
    this.volume = new GainNode(this.context, { gain });
    this.volume.connect(this.context.destination);
    // How loud it was, pascals; gaps, parts left out to catch up, and seconds that sound waits.
    Object.assign(this, { peak: 0, underruns: 0, skips: 0, behind: 0 });
  }

  // Browsers let sound begin after a click or a key.
  resume() {
    if (this.context.state === "suspended") this.context.resume();
  }

  // What is heard from now on as a stream of its own, until `end`.
  recorded() {
    const node = this.context.createMediaStreamDestination();
    this.volume.connect(node);
    return { stream: node.stream, end: () => this.volume.disconnect(node) };
  }

  // Plays until it fails. Without a device, or before a click, sound is dropped and the world goes on.
  async listen({ heard, counted }) {
    const { context } = this;
    await context.audioWorklet.addModule("sound_player.js");
    const player = new AudioWorkletNode(context, "sound-player", { numberOfInputs: 0, outputChannelCount: [1] });
    player.connect(this.volume);
    player.port.onmessage = ({ data }) => counted(Object.assign(this, data));
    const { port1, port2 } = new MessageChannel();
    player.port.postMessage(port1, [port1]);
    const worker = new Worker(`sound_worker.js${location.search}`, { type: "module" });
    const running = () => context.state === "running";
    context.onstatechange = () => worker.postMessage({ running: running() });
    return new Promise((_, fail) => {
      worker.onmessage = ({ data: { peak, said, failed } }) => {
        if (failed) fail(new Error(failed));
        else heard({ peak: (this.peak = Math.max(this.peak, peak)), said });
      };
      worker.postMessage({ player: port2, running: running() }, [port2]);
    });
  }
}

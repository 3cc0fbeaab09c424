// The gains of modes at stored places, and the sound that they make.

// Of its amplitude; a mode of a player ends where it has fallen to this.
const FLOOR = 1e-6;

// Samples of modes by their amplitudes; each is a recursion of two terms: a, b, and its first two samples.
export function sounding(recursions, amplitudes, count, floor = 0) {
  const total = new Float64Array(count);
  amplitudes.forEach((amplitude, mode) => {
    const [a, b, first, second] = recursions[mode];
    const least = floor * Math.abs(amplitude);
    let [now, next] = [amplitude * first, amplitude * second];
    for (let n = 0; n < count && Math.abs(now) + Math.abs(next) > least; n += 1) {
      total[n] += now;
      [now, next] = [next, a * next + b * now];
    }
  });
  return total;
}

export class StoredModes {
  constructor({ frequencies_hz, dampings_per_s, sample_rate_hz, recursions, gain_steps }, { gains }, places) {
    [this.frequencies, this.dampings, this.rate] = [frequencies_hz, dampings_per_s, sample_rate_hz];
    Object.assign(this, { recursions, steps: gain_steps, gains, places });
  }

  // Velocity along the normal, m/s, that an impulse (newton seconds) gives each mode at a stored place.
  amplitudes(place, impulse) {
    const { normal } = this.places[place];
    return this.steps.map((step, mode) => {
      let [struck, moved] = [0, 0];
      for (let axis = 0; axis < 3; axis += 1) {
        const gain = step * this.gains[(mode * 3 + axis) * this.places.length + place];
        struck += gain * impulse[axis];
        moved += gain * normal[axis];
      }
      return struck * moved;
    });
  }

  // The velocity along the normal where it is struck, m/s.
  sound(amplitudes, duration) {
    return Float32Array.from(sounding(this.recursions, amplitudes, Math.round(duration * this.rate), FLOOR));
  }
}

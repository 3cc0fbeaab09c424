// Where the camera and the lamp stand: angles on the screen to poses of `objectfolder.vision.cameras`.
import { dot, plus, minus, times, cross, unit, clamp } from "./algebra.js";

const DEGREE = Math.PI / 180;
export const FIELD_OF_VIEW_DEG = 39.6;
const NEAREST = 1.2;
const FARTHEST = 4;
// Short of the pole, where the z axis no longer says what is up.
const STEEPEST = 89;

export class Orbit {
  // `frame` has the centre and the scale of the unit frame, metres; `reach` is how far the object reaches
  // from the centre, in the unit frame.
  constructor(frame, reach) {
    this.frame = frame;
    this.reach = reach;
    this.reset();
  }

  reset() {
    // The camera's place on its sphere (degrees, unit frame) and the lamp's, as the camera sees it.
    const whole = (1.03 * this.reach) / Math.sin((FIELD_OF_VIEW_DEG * DEGREE) / 2);
    Object.assign(this, { azimuth: -60, elevation: 28, radius: clamp(whole, NEAREST, FARTHEST) });
    this.lamp = { across: -20, up: 28, radius: 1 };
    // A studio by its name, or null: then the one lamp is on.
    this.studio = "studio";
  }

  turn(across, up) {
    this.azimuth = ((this.azimuth + across + 540) % 360) - 180;
    this.elevation = clamp(this.elevation + up, -STEEPEST, STEEPEST);
  }

  zoom(factor) {
    this.radius = clamp(this.radius * factor, NEAREST, FARTHEST);
  }

  moveLamp(across, up) {
    this.lamp.across = ((this.lamp.across + across + 540) % 360) - 180;
    this.lamp.up = clamp(this.lamp.up + up, -90, 90);
  }

  // Right, up and backward, and the position in the unit frame.
  axes() {
    const [a, e] = [this.azimuth * DEGREE, this.elevation * DEGREE];
    const backward = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const right = unit(cross([0, 0, 1], backward));
    return { right, up: cross(backward, right), backward, position: times(backward, this.radius) };
  }

  toObject(point) {
    return plus(times(point, this.frame.scale), this.frame.centre);
  }

  cameraToWorld() {
    const { right, up, backward, position } = this.axes();
    const at = this.toObject(position);
    return [0, 1, 2].map((row) => [right[row], up[row], backward[row], at[row]]).concat([[0, 0, 0, 1]]);
  }

  // Of the one lamp; null in the studio, whose lamps stand with the camera.
  lightPosition() {
    if (this.studio) return null;
    const { right, up, backward } = this.axes();
    const [across, high] = [this.lamp.across * DEGREE, this.lamp.up * DEGREE];
    const level = plus(times(right, Math.sin(across)), times(backward, Math.cos(across)));
    const direction = plus(times(level, Math.cos(high)), times(up, Math.sin(high)));
    return this.toObject(times(direction, this.lamp.radius));
  }

  // The ray through a place of the square image, each coordinate 0 to 1 from its top left; object frame.
  ray(x, y) {
    const { right, up, backward, position } = this.axes();
    const half = Math.tan((FIELD_OF_VIEW_DEG * DEGREE) / 2);
    const aside = plus(times(right, (2 * x - 1) * half), times(up, (1 - 2 * y) * half));
    return { origin: this.toObject(position), direction: unit(minus(aside, backward)) };
  }

  // Where a point of the object frame is in the image, as `ray` counts.
  project(point) {
    const { right, up, backward, position } = this.axes();
    const away = minus(times(minus(point, this.frame.centre), 1 / this.frame.scale), position);
    const depth = -dot(away, backward) * Math.tan((FIELD_OF_VIEW_DEG * DEGREE) / 2);
    return [(1 + dot(away, right) / depth) / 2, (1 - dot(away, up) / depth) / 2];
  }
}

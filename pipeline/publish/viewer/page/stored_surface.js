// The surface: vertices as the package decodes them, normals, and the first place that a ray meets.
import { dot, plus, minus, times, cross, length, unit, clamp } from "./algebra.js";

// Faces that turn less are shaded as one, more as two, smoothly between: as `geometry.normals` does.
const [SMOOTH, SHARP] = [30, 50].map((angle) => Math.cos((angle * Math.PI) / 180));

export class StoredSurface {
  constructor(header, arrays) {
    const { origin, step } = header.surface;
    this.faces = arrays.faces;
    this.vertices = Float64Array.from(arrays.positions, (value, index) => origin[index % 3] + value * step);
    this.faceCount = this.faces.length / 3;
    this._normals();
    this._bins();
  }

  vertex(index) {
    return [this.vertices[3 * index], this.vertices[3 * index + 1], this.vertices[3 * index + 2]];
  }

  // Of the farthest vertex from the centre of a unit frame, in its unit.
  reach({ centre, scale }) {
    let farthest = 0;
    for (const index of this.faces) farthest = Math.max(farthest, length(minus(this.vertex(index), centre)));
    return farthest / scale;
  }

  corners(face) {
    return [0, 1, 2].map((corner) => this.vertex(this.faces[3 * face + corner]));
  }

  // Face normals, and shading normals of the corners.
  _normals() {
    this.faceNormals = new Float64Array(3 * this.faceCount);
    const angles = new Float64Array(this.faces.length);
    const around = Array.from({ length: this.vertices.length / 3 }, () => []);
    for (let face = 0; face < this.faceCount; face += 1) {
      const corners = this.corners(face);
      const normal = unit(cross(minus(corners[1], corners[0]), minus(corners[2], corners[0])));
      this.faceNormals.set(normal, 3 * face);
      for (let corner = 0; corner < 3; corner += 1) {
        const [a, b] = [1, 2].map((next) => unit(minus(corners[(corner + next) % 3], corners[corner])));
        angles[3 * face + corner] = Math.atan2(length(cross(a, b)), dot(a, b));
        around[this.faces[3 * face + corner]].push(3 * face + corner);
      }
    }
    this.cornerNormals = new Float32Array(3 * this.faces.length);
    for (let vertex = 0; vertex < around.length; vertex += 1) {
      for (const corner of around[vertex]) {
        const own = this._faceNormal(Math.floor(corner / 3));
        let smooth = [0, 0, 0];
        for (const other of around[vertex]) {
          const normal = this._faceNormal(Math.floor(other / 3));
          const ramp = clamp((dot(own, normal) - SHARP) / (SMOOTH - SHARP), 0, 1);
          if (ramp > 0) smooth = plus(smooth, times(normal, angles[other] * ramp * ramp * (3 - 2 * ramp)));
        }
        this.cornerNormals.set(length(smooth) > 1e-9 ? unit(smooth) : own, 3 * corner);
      }
    }
  }

  _faceNormal(face) {
    return [0, 1, 2].map((axis) => this.faceNormals[3 * face + axis]);
  }

  // Spheres round runs of faces: the surface is stored in walking order, so that runs are compact.
  _bins() {
    const size = 24;
    this.bins = [];
    for (let start = 0; start < this.faceCount; start += size) {
      const stop = Math.min(start + size, this.faceCount);
      const low = [Infinity, Infinity, Infinity];
      const high = [-Infinity, -Infinity, -Infinity];
      for (let index = 3 * start; index < 3 * stop; index += 1) {
        for (let axis = 0; axis < 3; axis += 1) {
          const value = this.vertices[3 * this.faces[index] + axis];
          low[axis] = Math.min(low[axis], value);
          high[axis] = Math.max(high[axis], value);
        }
      }
      const centre = times(plus(low, high), 0.5);
      this.bins.push({ start, stop, centre, radius: (length(minus(high, low)) / 2) * 1.000001 });
    }
  }

  // First hit, on either side of a face: {point, normal}, or null. Moeller and Trumbore 1997.
  firstHit(origin, direction) {
    let best = null;
    let nearest = Infinity;
    for (const { start, stop, centre, radius } of this.bins) {
      const away = minus(centre, origin);
      const along = dot(away, direction);
      if (dot(away, away) - along * along > radius * radius) continue;
      for (let face = start; face < stop; face += 1) {
        const [a, b, c] = this.corners(face);
        const [ab, ac] = [minus(b, a), minus(c, a)];
        const p = cross(direction, ac);
        const determinant = dot(ab, p);
        if (determinant === 0) continue;
        const t = minus(origin, a);
        const u = dot(t, p) / determinant;
        const q = cross(t, ab);
        const v = dot(direction, q) / determinant;
        const distance = dot(ac, q) / determinant;
        if (u < 0 || v < 0 || u + v > 1 || distance <= 0 || distance >= nearest) continue;
        nearest = distance;
        best = { face, barycentric: [1 - u - v, u, v] };
      }
    }
    return best && this.placeOn(best.face, best.barycentric);
  }

  // {point, normal} of a place on a face.
  placeOn(face, barycentric) {
    const interpolated = (values, indices) =>
      [0, 1, 2].map((axis) => indices.reduce((sum, at, corner) => sum + barycentric[corner] * values[3 * at + axis], 0));
    const three = [0, 1, 2].map((corner) => 3 * face + corner);
    const point = interpolated(this.vertices, three.map((corner) => this.faces[corner]));
    return { point, normal: unit(interpolated(this.cornerNormals, three)) };
  }
}

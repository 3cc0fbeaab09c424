// A rigid press of the sensor: where it stands, and how deep the object lies in its gel.
//
// The pose is that of `objectfolder.touch`; the gel's first contact and what the camera sees are found on
// grids of places, where the package solves for them, and no light is drawn.
"use strict";
(function (viewer) {
  const { dot, plus, minus, times, cross, length, unit, clamp } = viewer.algebra;
  const DEGREE = Math.PI / 180;
  // The other side of a thin part is left out of the contact normal, as `touch/pose.py` does.
  const OTHER_SIDE_COSINE = -Math.SQRT1_2;
  const POLE_RAD = 1e-3;
  const GRID_M = 1.5e-4;
  const TOLERANCE_M = 2e-5;

  class StoredTouch {
    constructor(sensor, surface) {
      this.sensor = sensor;
      this.surface = surface;
      const corner = (sensor.gel_width_m ** 2 + sensor.gel_height_m ** 2) / 4;
      this.stretch = sensor.gel_sagitta_m / (sensor.gel_radius_m - Math.sqrt(sensor.gel_radius_m ** 2 - corner));
    }

    // Depths (m) row by row, and labels, of a press at a point with its shading normal.
    press(point, normal, depth, tilt, azimuth) {
      const mean = this._contactNormal(point, normal);
      const axes = tilted(contactAxes(mean), tilt * DEGREE, azimuth * DEGREE);
      const inward = axes.map((axis) => -dot(mean, axis));
      const onGel = this._gelPoint(inward[1] / inward[0], inward[2] / inward[0]);
      let origin = point;
      axes.forEach((axis, index) => (origin = minus(origin, times(axis, onGel[index]))));
      const offset = Math.max(0, this._deepest(this._seen(origin, axes)));
      origin = plus(origin, times(axes[0], depth - offset));
      const triangles = this._seen(origin, axes);
      const reachable =
        offset <= depth + TOLERANCE_M && this._deepest(triangles) <= depth + TOLERANCE_M && !this._meetsHousing(triangles);
      const image = this._image(triangles, reachable ? depth : 0);
      return { ...image, reachable, penetration_m: reachable ? depth : 0 };
    }

    _gelSag(squared) {
      const radius = this.sensor.gel_radius_m;
      return this.stretch * (radius - Math.sqrt(Math.max(radius * radius - squared, 0)));
    }

    _gelX(y, z) {
      const [x0, y0, z0] = this.sensor.gel_apex_m;
      return x0 - this._gelSag((y - y0) ** 2 + (z - z0) ** 2);
    }

    _gelPoint(slopeY, slopeZ) {
      const scale = this.stretch > 0 ? this.sensor.gel_radius_m / Math.sqrt(this.stretch ** 2 + slopeY ** 2 + slopeZ ** 2) : 0;
      const [y, z] = [slopeY * scale, slopeZ * scale];
      return plus(this.sensor.gel_apex_m, [-this._gelSag(y * y + z * z), y, z]);
    }

    // The mean normal in a ball: each face weighted by the area of its plane's disc that it covers.
    _contactNormal(point, normal) {
      const radius = this.sensor.contact_radius_m;
      let total = [0, 0, 0];
      for (const { start, stop, centre, radius: reach } of this.surface.bins) {
        if (length(minus(centre, point)) > reach + radius) continue;
        for (let face = start; face < stop; face += 1) {
          const facing = [0, 1, 2].map((axis) => this.surface.faceNormals[3 * face + axis]);
          const side = clamp(1 - dot(facing, normal) / OTHER_SIDE_COSINE, 0, 1);
          const corners = this.surface.corners(face).map((corner) => minus(corner, point));
          const height = dot(facing, corners[0]);
          if (side <= 0 || Math.abs(height) >= radius) continue;
          const flat = corners.map((corner) => minus(corner, times(facing, height)));
          const area = discOverlap(flat, facing, radius * radius - height * height);
          total = plus(total, times(facing, area * side * side * (3 - 2 * side)));
        }
      }
      return length(total) > 1e-3 * radius * radius ? unit(total) : normal;
    }

    // Triangles in the sensor frame that lie near it or behind it: nine numbers each.
    _seen(origin, axes) {
      const { sensor, surface } = this;
      const middle = plus(origin, axes.reduce((sum, axis, index) => plus(sum, times(axis, sensor.gel_apex_m[index])), [0, 0, 0]));
      const found = [];
      for (const { start, stop, centre, radius } of surface.bins) {
        const away = minus(centre, middle);
        const along = dot(away, axes[0]);
        if (along > radius + 0.06 || length(minus(away, times(axes[0], along))) > radius + 0.06) continue;
        for (let face = start; face < stop; face += 1) {
          found.push(surface.corners(face).map((corner) => axes.map((axis) => dot(minus(corner, origin), axis))));
        }
      }
      return found;
    }

    // The largest indentation of the gel, m; negative where nothing meets it.
    _deepest(triangles) {
      const { camera_position_m: camera, near_m, gel_apex_m: apex, gel_width_m, gel_height_m } = this.sensor;
      const rear = camera[0] + near_m;
      let deepest = -Infinity;
      const box = [apex[1] - gel_width_m / 2, apex[1] + gel_width_m / 2, apex[2] - gel_height_m / 2, apex[2] + gel_height_m / 2];
      eachPlace(triangles, box, ([x, y, z]) => {
        if (x >= rear) deepest = Math.max(deepest, this._gelX(y, z) - x);
      });
      return deepest;
    }

    // At its place or on its straight way there.
    _meetsHousing(triangles) {
      const { housing_low_m: low, housing_high_m: high } = this.sensor;
      let meets = false;
      eachPlace(triangles, [low[1], high[1], low[2], high[2]], ([x]) => (meets ||= x < high[0]));
      return meets;
    }

    // What the camera sees of the object within the gel: a ray through the middle of each pixel.
    _image(triangles, depth) {
      const { image_height: height, image_width: width, field_of_view_deg, camera_position_m: camera, near_m } = this.sensor;
      const pitch = (2 * Math.tan((field_of_view_deg * DEGREE) / 2)) / height;
      const nearest = new Float64Array(width * height).fill(Infinity);
      for (const triangle of depth > 0 ? triangles : []) {
        const away = triangle.map((corner) => minus(corner, camera));
        if (away.some(([x]) => x <= near_m)) continue;
        // Columns run along -y and rows along -z; the inverse of the distance is linear over the image.
        const flat = away.map(([x, y, z]) => [width / 2 - y / x / pitch, height / 2 - z / x / pitch, 1 / x]);
        covered(flat, width, height, (pixel, inverse) => {
          nearest[pixel] = Math.min(nearest[pixel], 1 / inverse);
        });
      }
      const depths = new Float32Array(width * height);
      let area = 0;
      nearest.forEach((distance, pixel) => {
        if (distance === Infinity) return;
        const u = (width / 2 - 0.5 - (pixel % width)) * pitch;
        const v = (height / 2 - 0.5 - Math.floor(pixel / width)) * pitch;
        const indentation = this._gelX(camera[1] + distance * u, camera[2] + distance * v) - camera[0] - distance;
        if (indentation <= 0) return;
        depths[pixel] = Math.min(indentation, depth);
        area += (distance * pitch) ** 2;
      });
      return { width, height, depth: depths, contact_area_m2: area };
    }
  }

  // Area that a triangle, in a plane through the origin, shares with a disc round it.
  function discOverlap(corners, normal, squaredRadius) {
    let area = 0;
    for (let index = 0; index < 3; index += 1) {
      const [p, q] = [corners[index], corners[(index + 1) % 3]];
      const along = minus(q, p);
      const a = Math.max(dot(along, along), 1e-300);
      const halfB = dot(along, p);
      const root = Math.sqrt(Math.max(halfB * halfB - a * (dot(p, p) - squaredRadius), 0));
      const first = plus(p, times(along, clamp((-halfB - root) / a, 0, 1)));
      const last = plus(p, times(along, clamp((-halfB + root) / a, 0, 1)));
      const sector = (s, t) => Math.atan2(dot(cross(s, t), normal), dot(s, t));
      area += (squaredRadius * (sector(p, first) + sector(last, q)) + dot(cross(first, last), normal)) / 2;
    }
    return Math.max(area, 0);
  }

  // The sensor's x, y and z in the object frame for a press against a normal (`touch/pose.py`).
  function contactAxes([x, y, z]) {
    if (z < 0 && x * x + y * y < POLE_RAD ** 2) {
      const turn = 1 / (1 - z);
      return [[-x, -y, -z], [1 - turn * x * x, -turn * x * y, x], [-turn * x * y, 1 - turn * y * y, y]];
    }
    const lateral = Math.hypot(x, y);
    const [cosine, sine] = lateral > 0 ? [x / lateral, y / lateral] : [1, 0];
    const turn = z > 0 ? (lateral * lateral) / (1 + z) : 1 - z;
    return [
      [-x, -y, -z],
      [turn * cosine * cosine - 1, turn * cosine * sine, x],
      [-turn * cosine * sine, 1 - turn * sine * sine, -y],
    ];
  }

  function tilted(axes, tilt, azimuth) {
    if (tilt === 0) return axes;
    const towards = minus(times(axes[2], Math.sin(azimuth)), times(axes[1], Math.cos(azimuth)));
    const axis = cross(times(axes[0], -1), towards);
    return axes.map((own) => {
      const parallel = times(axis, dot(axis, own));
      return plus(plus(times(minus(own, parallel), Math.cos(tilt)), times(cross(axis, own), Math.sin(tilt))), parallel);
    });
  }

  // A grid of places of triangles, and places along their edges, that lie above a box of y and z.
  function eachPlace(triangles, [yLow, yHigh, zLow, zHigh], visit) {
    const [columns, rows] = [Math.round((yHigh - yLow) / GRID_M), Math.round((zHigh - zLow) / GRID_M)];
    for (const triangle of triangles) {
      triangle.forEach((start, corner) => {
        const along = minus(triangle[(corner + 1) % 3], start);
        const steps = Math.ceil(length(along) / GRID_M);
        for (let step = 0; step < steps; step += 1) {
          const [x, y, z] = plus(start, times(along, step / steps));
          if (y >= yLow && y <= yHigh && z >= zLow && z <= zHigh) visit([x, y, z]);
        }
      });
      const flat = triangle.map(([x, y, z]) => [(y - yLow) / GRID_M, (z - zLow) / GRID_M, x]);
      covered(flat, columns, rows, (place, x) => {
        visit([x, yLow + ((place % columns) + 0.5) * GRID_M, zLow + (Math.floor(place / columns) + 0.5) * GRID_M]);
      });
    }
  }

  // Visits the pixels whose middle a triangle of (column, row, value) covers, with the value there.
  function covered([a, b, c], columns, rows, visit) {
    const doubled = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if (doubled === 0) return;
    const range = (axis, last) => [
      Math.max(0, Math.ceil(Math.min(a[axis], b[axis], c[axis]) - 0.5)),
      Math.min(last, Math.floor(Math.max(a[axis], b[axis], c[axis]) - 0.5)),
    ];
    const [[left, right], [top, bottom]] = [range(0, columns - 1), range(1, rows - 1)];
    for (let row = top; row <= bottom; row += 1) {
      for (let column = left; column <= right; column += 1) {
        const [x, y] = [column + 0.5, row + 0.5];
        const second = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / doubled;
        const third = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / doubled;
        if (second < 0 || third < 0 || second + third > 1) continue;
        visit(row * columns + column, a[2] + second * (b[2] - a[2]) + third * (c[2] - a[2]));
      }
    }
  }

  viewer.StoredTouch = StoredTouch;
})((window.objectfolderViewer ??= {}));

// Vectors as arrays of three numbers, poses as four rows of four.
"use strict";
(function (viewer) {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const plus = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
  const minus = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
  const times = (a, factor) => [a[0] * factor, a[1] * factor, a[2] * factor];
  const cross = (a, b) => [
    a[1] * b[2] - a[2] * b[1],
    a[2] * b[0] - a[0] * b[2],
    a[0] * b[1] - a[1] * b[0],
  ];
  const length = (a) => Math.hypot(a[0], a[1], a[2]);
  const unit = (a) => times(a, 1 / (length(a) || 1));
  const clamp = (value, low, high) => Math.min(high, Math.max(low, value));
  viewer.algebra = { dot, plus, minus, times, cross, length, unit, clamp };
})((window.objectfolderViewer ??= {}));

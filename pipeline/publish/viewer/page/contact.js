// The direction of a blow, as chosen on the page.
import { dot, times } from "./algebra.js";

export const DIRECTIONS = [
  ["normal", "into the surface"],
  ["view", "away from you"],
  ["down", "downwards (−z)"],
  ["across", "sideways (+x)"],
];

// The side of the surface that was struck: its normal against the ray.
export const outward = (normal, ray) => (dot(normal, ray) > 0 ? times(normal, -1) : normal);

export function pushOf(along, normal, ray) {
  if (along === "normal") return times(normal, -1);
  if (along === "view") return ray;
  return along === "down" ? [0, 0, -1] : [1, 0, 0];
}

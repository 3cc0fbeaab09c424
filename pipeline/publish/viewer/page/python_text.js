// A query as Python that asks `objectfolder` the same. Numbers are written so that they read back exactly.

const row = (values) => `[${values.map(String).join(", ")}]`;
const matrix = (rows) => `[\n${rows.map((values) => `    ${row(values)},\n`).join("")}]`;

// `asked`: file, view {camera_to_world, light_position or null, studio, resolution}, and strike or press or neither.
export function pythonText({ file, view, strike, press }) {
  const lines = [
    "import numpy as np",
    "import objectfolder",
    "",
    `file = objectfolder.load(${JSON.stringify(file)})`,
    `camera_to_world = np.array(${matrix(view.camera_to_world)})  # object frame, metres`,
    ...(view.light_position
      ? [
          `light_position = np.array(${row(view.light_position)})`,
          `image = file.render(camera_to_world, light_position, resolution=${view.resolution})[0]`,
        ]
      : [`image = file.pictures(camera_to_world, resolution=${view.resolution}, studio=${JSON.stringify(view.studio)})[0]`]),
  ];
  const contact = strike || press;
  if (contact) {
    lines.push(
      "",
      `point = np.array(${row(contact.point)})  # metres, on the surface`,
      `normal = np.array(${row(contact.normal)})`,
    );
  }
  if (strike) {
    lines.push(
      `impulse = np.array(${row(strike.impulse)})  # newton seconds`,
      `sound = file.strike(point, impulse, duration_s=${strike.duration}, sample_rate_hz=${strike.sample_rate})[0]`,
      "amplitudes = file.mode_velocities(point, impulse)[0]  # m/s, of file.modes.frequencies_hz",
    );
  }
  if (press) {
    lines.push(
      `touch = file.press(point, depth_m=${press.depth}, tilt_deg=${press.tilt}, azimuth_deg=${press.azimuth})`,
      "tactile = touch.rgb[0]  # (160, 120, 3); touch.depth_m, touch.mask, touch.reachable, ...",
    );
  }
  return `${lines.join("\n")}\n`;
}

/** Advice for a camera to cover a face, with its figures, as rastercov/coverage/advice.py words it. */

const DENSITIES = ["pixel_density", "facing_density"]; // each has a minimum in a task

/** A number in some significant digits, or in two where it is below 1e-4, as rastercov/base/format.py has it. */
export function number(value, digits = 3) {
  if (!Number.isFinite(value)) return "inf";
  const isTiny = value !== 0 && Math.abs(value) < 1e-4;
  const text = isTiny ? value.toExponential(1) : value.toPrecision(digits);
  if (/e\+\d$/.test(text)) return Number(text).toLocaleString("en");
  const short = text.includes(".") && !isTiny ? text.replace(/\.?0+(?=e|$)/, "") : text;
  return short.replace(/e([+-])(\d)$/, "e$10$2");
}

const lengthOf = (value, unit) => {
  if (unit === "m" && value > 0 && value < 0.01) return `${number(1e3 * value)} mm`;
  return `${number(value)} ${unit === "m" ? "m" : "units"}`;
};

/** A density in the unit of the larger of it and one beside it. */
export const densityOf = (value, unit, beside = 0) =>
  unit === "m" && Math.max(value, beside) >= 1e3 ? `${number(value / 1e3)} px/mm` : `${number(value)} px/${unit}`;

function rangeOf(depths, unit) {
  const [near, far] = [Math.min(...depths), Math.max(...depths)].map((depth) => lengthOf(depth, unit));
  if (near === far) return far;
  const end = far.slice(far.indexOf(" "));
  return `${near.endsWith(end) ? near.slice(0, -end.length) : near} to ${far}`;
}

/** The minimum that figures miss by the largest factor, {factor, found, wanted}; null where they meet all. */
function shortOf(figures, task, unit) {
  const missed = DENSITIES.flatMap((name) => {
    const [own, least] = [figures[name], task[`min_${name}`]];
    if (!(own > 0 && own < least)) return [];
    const [said, headOn] = [own, figures.facing_density].map((value) => densityOf(value, unit, figures.facing_density));
    const found = name === "facing_density" || said === headOn ? said : `${said} (${headOn} head-on)`;
    return [{ factor: least / own, found, wanted: densityOf(least, unit) }];
  });
  return missed.reduce((most, each) => (most && most.factor >= each.factor ? most : each), null);
}

/**
 * Advice of a template for figures {distance, angle, depths, pixel_density, facing_density} of a face in a
 * camera, metres and degrees; `task` has its thresholds, `focus` its depth of field, `hider` a name.
 */
export function adviceFor(template, general, figures, { task, focus, hider, unit }) {
  const short = shortOf(figures, task, unit);
  if (template.includes("{found}") && !short) return general;
  const { distance, angle, depths } = figures;
  const [near, far] = focus;
  const values = {
    wider: depths.every((depth) => depth > 0) ? " or use a wider lens" : "",
    depth: rangeOf(depths, unit),
    in_focus: `${lengthOf(near, unit)} ${Number.isFinite(far) ? `to ${lengthOf(far, unit)}` : "or more"}`,
    found: short?.found,
    wanted: short?.wanted,
    distance: lengthOf(distance, unit),
    nearer: lengthOf(distance / (short?.factor ?? 1), unit),
    times: `${number(short?.factor ?? 1, 2)} times`,
    hider: hider ? `"${hider}"` : "the obstacle",
    angle: number(angle),
    max_angle: number(task.max_incidence_deg, 6),
  };
  return template.replace(/\{(\w+)\}/g, (_, name) => values[name]);
}

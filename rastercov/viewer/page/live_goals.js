/** What a plan asks of the task and its groups, as rastercov/placement/plan/network.py judges it. */

import { squareMetres } from "rastercov/dom.js";
import { number } from "rastercov/live_advice.js";

const TOLERANCE = 1e-9;

/** A share in percent, rounded neither to 100 nor to 0. */
function percentOf(value) {
  const share = Number(value.toFixed(12));
  for (const digits of [1, 2, 3, 6]) {
    const text = (100 * share).toFixed(digits);
    if ((Number(text) < 100 || share >= 1) && (Number(text) > 0 || share <= 0)) return `${text} %`;
  }
  return share > 0.5 ? "99.999999 %" : "0.000001 %";
}

/** {goal, status, words, asked} of a share {name, limit, ...} that is required or, where `is_most`, permitted,
 * by the covered area of its groups, with its bound. */
export function requirementOf(asked, { m2, bound_m2: bound, doubtful_m2: doubtful, of_m2: whole }) {
  const { name, limit, goal = "", is_most: isMost = false } = asked;
  const [low, share, high] = [m2 - bound, m2, m2 + bound + doubtful].map((part) =>
    whole > 0 ? Math.min(Math.max(part / whole, 0), 1) : 1,
  );
  const [sure, other] = isMost ? [high <= limit + TOLERANCE, low <= limit + TOLERANCE] : [low, high].map((end) => end >= limit - TOLERANCE);
  const status = sure ? "holds" : other ? "undecided" : "fails";
  let words = `${name}: ${percentOf(share)} of the area covered, ${percentOf(limit)} ${isMost ? "permitted at most" : "required"}`;
  if (status === "fails") {
    const short = percentOf(Math.max(0, isMost ? share - limit : limit - share)).replace(" %", "");
    words += `, ${short} percentage points ${isMost ? "too much" : `below the goal, ${squareMetres(whole - m2)} uncovered`}`;
  } else if (status === "undecided") {
    const ends = [low, high].map((end) => `${number(100 * end, 9)} %`);
    words += `, undecided: the error bound allows ${ends.join(" to ")}`;
  } else if (isMost) words += ": proved";
  return { goal, status, words, asked: asked.asked ?? "" };
}

/** What a plan asks of the task and its groups, as rastercov/placement/plan/network.py judges it. */

import { squareMetres } from "rastercov/dom.js";
import { ends_in_words, outcome_line, percent, share_of, short_by, status_of } from "rastercov/texts.js";

/** {goal, status, words, asked} of a share {name, limit, ...} that is required or, where `is_most`, permitted,
 * by the covered area of its groups, with its bound. */
export function requirementOf(asked, { m2, bound_m2: bound, doubtful_m2: doubtful, of_m2: whole }) {
  const { name, limit, goal = "", is_most: isMost = false } = asked;
  const [low, share, high] = [m2 - bound, m2, m2 + bound + doubtful].map((part) => share_of(part, whole));
  const status = status_of(low, high, limit, isMost);
  const texts = [short_by(share, limit, status, isMost), squareMetres(whole - m2), ends_in_words(low, high)];
  const words = outcome_line(`${name}: ${percent(share)} of the area covered, `, status, [limit, null], ...texts, isMost);
  return { goal, status, words, asked: asked.asked ?? "" };
}

/**
 * Features of the page that can be deleted, a line each.
 *
 * Each is a function of a session that is open: what it adds there, or null. That may be `side()`, a
 * panel above all others; `network()`, one of the panel "Network"; `key(event)`, true for a key that it
 * used; and `help`, sections on keys. It may set `session.phases` for a scene of several phases: `at`,
 * numbers that name the one that is shown, and `show(at, bodies)`, by poses of bodies if they are sent.
 */

import { joints } from "rastercov/joints.js";
import { moving } from "rastercov/time.js";

export const FEATURES = [moving, joints];

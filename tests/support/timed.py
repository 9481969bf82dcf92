"""Coverage over time by `rc.evaluate` and `rc.regions`, from the parts of its query."""

import rastercov as rc


def evaluate_over_time(motion, camera, poses, task=None, over="some", **options):
    """`OverTime` of a motion; `views_at` and `body` are of the query."""
    asked, options = query(motion, over, options)
    options = {"fields": ()} | options
    return rc.evaluate(motion.mesh, camera, poses, task, motion=asked, **options).over_time


def regions_over_time(motion, camera, poses, task=None, **options):
    """Regions of each frame."""
    asked, options = query(motion, "some", options)
    return rc.regions(motion.mesh, camera, poses, task, motion=asked, **options)


def over_time(regions, motion, over="some", *, views=1, views_at="one time"):
    """Parts of regions of frames that are covered for long enough."""
    return rc.MotionQuery(motion, over, views_at).long_enough(regions, views)


def query(motion, over, options):
    """The query, and the options that are not its own."""
    own = {name: options[name] for name in ("views_at", "body") if name in options}
    return rc.MotionQuery(motion, over, **own), {n: options[n] for n in options.keys() - own.keys()}

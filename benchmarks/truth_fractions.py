"""Our own exact fractions, `reference/rational.py`: areas in hostile scenes without any rounding.

The campaign `attack_exact`, of which each certified and each computed figure is compared.
"""

from attack_exact import SCENE_KINDS, SCENES, Score
from attack_exact import compare as compare_scene
from compared import Compared, Comparison, amount

PART = 0.02
"""Of the scenes of the campaign, which takes hours."""


def fractions(effort: float) -> list[Compared]:
    """Certified and computed visible areas."""
    compared, score = Compared("areas in hostile scenes", "of the bound"), Score()
    for seed in range(amount(SCENES, PART * effort, len(SCENE_KINDS))):
        compared.faults += compare_scene(seed, score)
    compared.figures = score.certified + score.computed
    compared.beyond = score.wrong + score.exceeded
    compared.largest = score.worst
    return [compared]


COMPARISONS = [Comparison("exact fractions", None, fractions)]

"""Each sentence of README, guarantees and comparison has a test or command, or claims nothing."""

import json
import re
from pathlib import Path

import pytest

from rastercov.core.camera.catalogue import catalogue
from rastercov.core.camera.models import MODELS
from rastercov.formats.cameras import READERS

ROOT = Path(__file__).parents[1]
NOTHING = "claims nothing"
"""Of questions, links, instructions, and of what is expressly not promised and has no test."""
OF_OTHERS = "read in the source of another program"
MADE = "command benchmarks/comparison.py"
END = re.compile(r"(?:(?<=[a-z0-9)`*]\.)|(?<=\?\*\*)) (?=[A-Z`\[])(?!S\. |Eissa)")
"""Between two sentences: initials of a name end none."""
CLAIMS = {
    "README.md": {
        "**Which part of a": "area/test_recut another_cut_of_the_same_surface_has_the_same_cov",
        "It is for inspection": NOTHING,
        "Without a mesh": "test_shapes every_name_gives_the_same_sound_mesh_twice",
        "`evaluate` writes": "report/test_pages by_area_dead_zones_are_listed_and_drawn",
        "`view` opens": "viewer/test_browser a_slider_changes_the_summary_to_what",
        "The ranges are": "test_comparison ranges_of_the_readme_are_those_of_the_tables",
        "The [comparison]": "test_comparison errors_are_those_of_numbers_by_hand",
        "- Each visible or": "exact/test_certificate no_certificate_is_wrong_on_a_built_in_mesh",
        "Every other value": "test_observer the_bound_holds_for_nearly_all_partly_hidden_faces",
        "- No error exceeded": "attack exact",
        "- Results are": "test_threads six_threads_get_the_answers_of_one_bit_for_bit",
        "[Install](docs": NOTHING,
        "- **Cameras** are": "camera_formats/test_scenes what_is_written_shows_the_same_points",
        "`--poses sphere:40`": "test_through_lenses a_sphere_of_poses_sees_all_of_the_mesh",
        "- **Parts** are read": "mesh/test_mesh_file every_format_keeps_faces_corners_and_order",
        "- **The result** is": "area/test_recut cuts_rounded_off_the_surface_keep_the_area",
        "`method` is": "exact/test_half_planes any_camera_sees_as_in_exact_arithmetic",
        "The criteria are those": "test_criteria density_is_the_least_singular_value_of_finite",
        "`examples/` contains": "test_examples the_return_of_an_episode_is_what_its_views_cover",
        "A [plan file]": "plan/test_plan the_schema_in_docs_is_that_of_the_model",
        "[`place`]": "cli/test_place_command a_plan_gives_poses_that_evaluate_reads",
        "`check` tests a rig": "cli/test_place_command a_rig_that_covers_enough_passes",
        "The same areas and": "area/test_parallel_regions a_point_is_in_a_region_exactly_if",
        "`rastercov view": "viewer/test_browser a_slider_changes_the_summary_to_what",
        "`--export page.html`": "viewer/test_saving a_page_of_one_file_has_all_its_modules",
        "[Guarantees and limits]": "test_claims every_guarantee_names_its_test_on_the_page",
        "`make quick`": "test_docs the_site_is_whole_and_asks_nothing_of_the_network",
        "[CONTRIBUTING]": "test_docs files_that_a_contributor_is_sent_to_are_there",
        "Python 3.11 to 3.14": "test_packaging the_wheel_asks_only_for_the_stable_interface",
        "MIT licence": "test_packaging the_wheel_names_its_command_and_licence",
    },
    "docs/guarantees.md": {
        "Read this page": NOTHING,
        "Each guarantee names": "test_claims what_is_named_is_there",
        "**Mesh files.** Face": "mesh/test_mesh_file random_meshes_come_back_face_for_face",
        "Truncated, inconsistent": "mesh/test_mesh_text no_cut_changes_a_face_without_a_note",
        "The triangles of a": "mesh/test_concave_polygons simple_polygons_are_covered_exactly",
        "Time grows no faster": "attack readers",
        "**Exact visibility.**": "exact/test_certificate no_certificate_is_wrong_on_folded",
        "An exact figure is": "exact/test_rounding the_bound_of_a_solid_or_a_room_is_of_no",
        "None was wrong": "attack exact",
        "Where rounding": "exact/test_edge_on the_side_of_a_face",
        "**Rasterisers.**": NOTHING,
        "- At a pixel centre": "raster/test_raytrace built_in_part_is_seen_as_by_rays",
        "- For each pose": "raster/test_raster_faults counts_that_do_not_add_up_are_refused",
        "A device is": "raster/test_raster_faults device_that_goes_wrong_later_is_caught",
        "- Back faces are": "mesh/test_self_crossing culling_changes_no_area_of_solids",
        "- Through any lens": "raster/test_lenses each_sample_shows_the_face_its_ray_meets",
        "No sample is": "raster/test_lenses a_face_alone_is_drawn_where_its_own_rays_meet_it",
        "- A lens that is": "raster/test_lenses opengl_draws_a_lens_on_the_cpu_and_says_so",
        "- Moving mesh and": "raster/test_raster_laws exact_translation_and_scaling_change",
        "**Targets.** They": "test_targets coverage_of_a_face_has_the_same_bits_with_and",
        "**Determinism and": "test_threads six_threads_get_the_answers_of_one_bit_for_bit",
        "Threads may share": "raster/test_raster_faults use_from_a_second_thread_names",
        "**Files on disk.**": "report/test_report_folder a_kill_before_any_operation_leaves",
        "A visibility matrix": "placement/test_matrix only_the_damaged_shard_is_measured",
        "**Selection.** Every": "placement/test_lazy_selection no_selection_is_better_than",
        "The greedy rule": "placement/test_lazy_selection the_lazy_rule_takes_the_cameras",
        "**Errors.** Every": "test_misuse any_value_of_an_argument_is_used_or_refused",
        "**Time limit.**": "attack matrix",
        "**Sampled figures.**": "test_observer the_bound_holds_for_nearly_all_partly_hidden",
        "Small and thin faces": "test_coverage reason",
        "By face, one": "test_coverage a_face_far_smaller_than_a_pixel",
        "**Coincident surfaces.**": "raster/test_raster_laws of_coincident_faces_the_lowest",
        "If another face comes": "exact/test_nearly_coincident copies_are_within_their_bounds",
        "Sampled depths are": "raster/test_raster_laws surfaces_1e_5_apart_are_told_apart",
        "**Devices.**": NOTHING,
        "- The OpenGL graphics": "raster/test_extreme_cameras a_lens_too_long_for_float32",
        "Where a surface": "raster/test_raster_laws clipped_says_whether_a_surface_in_view",
        "- Two devices may": "raster/test_compute_raster it_fills_what_the_cpu_fills",
        "- OpenGL is tested": "raster/test_compute_raster a_graphics_card_sees_what_the_cpu",
        "**Cost.** A mesh": "exact/test_certificate faces_on_one_another_are_never_certified",
        "A watertight mesh that": "mesh/test_self_crossing one_component_that_touches_itself_is",
        "**File formats.** An": "mesh/test_mesh_text no_cut_changes_a_face_without_a_note",
        "Joints of skins are at": "mesh/test_concave_polygons a_polygon_that_crosses_itself_is",
        "STEP is triangulated": "mesh/test_mesh_step a_solid_is_read_in_its_own_unit",
        "`Mesh.notes` lists": "mesh/test_mesh notes_come_first_in_the_warnings",
        "**Results made by": "test_misuse what_is_not_tried_is_public_and_named_with_its_reason",
        "**Concurrency and": NOTHING,
        "Without `flock`": "report/test_report_folder a_file_system_without_locks_is",
        "Checksums protect": NOTHING,
        "**Integer program.**": "placement/test_selection the_time_limit_is_wall_time_from",
    },
    "docs/comparison.md": {
        "This page helps": NOTHING,
        "- **Exact visible areas": "test_truth programs_that_are_here_agree",
        "- **GPU tools** were": "command benchmarks/gpu.py",
        "- **One ray to each": "test_comparison rays_to_centroids_are_as_the_page_says",
        "- **Scenes and": NOTHING,
        "- **The reference** is": "test_truth a_difference_beyond_both_bounds_needs_a_reason",
        "`python benchmarks": "test_comparison the_command_compares_first_and_rewrites",
        "All tools compute": "test_comparison a_fraction_is_the_share_of_points",
        "1.": NOTHING,
        "The first table has": "test_comparison errors_are_those_of_numbers_by_hand",
        "The second has": "test_comparison the_command_compares_first_and_rewrites",
        "20": MADE,
        "- Rounds alternate": MADE,
        "Zhang's model and": MADE,
        "- For tools that": "test_comparison points_of_a_face_are_the_centroids",
        "- [Zhang's model]": "reference/test_algorithm1 centroid_sort_is_right_for_sheets",
        "For planners see": NOTHING,
        "Khepra's published": OF_OTHERS,
    },
}
"""Beginnings of sentences; a module and the beginning of a test in it, a campaign, or a command."""


def sentences(page):
    """Sentences outside of code, tables, headings and pictures, without the tests they name."""
    text = (ROOT / page).read_text(encoding="utf-8")
    text = re.sub(r"^```.*?^```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"^(?:#|!\[|\||<!--).*$", "", text, flags=re.MULTILINE)
    for block in re.split(r"\n\s*\n|\n(?=- )", text):
        line = re.sub(r" \[(?:`|\[)[^|]*\]$", "", " ".join(block.split()))
        yield from filter(None, END.split(glued(line)))


def glued(line):
    """A paragraph's name in bold belongs to its first sentence."""
    return re.sub(r"^(\*\*[^*]+)\.\*\* ", r"\1\0** ", line)


@pytest.mark.parametrize("page", CLAIMS)
def test_every_sentence_has_its_test(page):
    copies = [sentence.replace("\0", ".") for sentence in sentences(page)]
    for sentence in copies:
        known = [begin for begin in CLAIMS[page] if sentence.startswith(begin)]
        assert len(known) == 1, f"{page}: name a test in CLAIMS, or delete: {sentence}"
    unused = [b for b in CLAIMS[page] if not any(s.startswith(b) for s in copies)]
    assert unused == []


def is_there(proof):
    """Whether one test, a campaign of benchmarks/attack.py, or a command is meant."""
    module, _, name = proof.partition(" ")
    if module == "command":
        return (ROOT / name).exists()
    if module == "attack":
        return (ROOT / "benchmarks" / f"attack_{name}.py").exists()
    file = ROOT / "tests" / f"{module}.py"
    text = file.read_text(encoding="utf-8") if file.exists() else ""
    return len(re.findall(rf"^def test_{name}", text, re.MULTILINE)) == 1


def test_what_is_named_is_there():
    proofs = {proof for page in CLAIMS.values() for proof in page.values()} - {NOTHING, OF_OTHERS}
    assert [proof for proof in proofs if not is_there(proof)] == []
    page = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
    named = re.findall(r"`((?:tests|benchmarks)/[^`]+)`", page)
    campaigns = [name.partition(" ")[2] for name in named if " " in name]
    assert [name for name in campaigns if not is_there(f"attack {name}")] == []
    assert [name for name in named if not (ROOT / name.partition(" ")[0]).exists()] == []


def test_every_guarantee_names_its_test_on_the_page():
    page = (ROOT / "docs" / "guarantees.md").read_text(encoding="utf-8")
    part = page.split("## Guaranteed")[1].split("\n## ")[0]
    items = [item.strip() for item in re.split(r"\n\s*\n|\n(?=- )", part)]
    items = [item for item in items if item not in ("", "**Rasterisers.**")]
    assert [item for item in items if not re.search(r"`(?:tests|benchmarks)/", item)] == []


def numbers(page, *words):
    """The number in front of each of these words, once on a page."""
    text = (ROOT / page).read_text(encoding="utf-8")
    return [int(*re.findall(rf"\b(\d+) {word}", text)) for word in words]


def generators(schema):
    """Names of generators in a schema."""
    if isinstance(schema, dict):
        of_entry = schema.get("generator", {})
        yield from of_entry.get("enum", [of_entry[key] for key in ("const",) if key in of_entry])
        schema = list(schema.values())
    for each in schema if isinstance(schema, list) else ():
        yield from generators(each)


def test_pages_count_what_there_is():
    table = catalogue()
    known = [len(table.cameras), len(table.lenses), len(table.lamps)]
    assert numbers("docs/catalogue.md", "cameras, ", "lenses and", "lamps, each") == known
    assert numbers("README.md", r"lens models\]") == [len(MODELS)]
    plan = json.loads((ROOT / "docs" / "plan.schema.json").read_text(encoding="utf-8"))
    made = [len(MODELS), len(READERS), len({*generators(plan)})]
    assert numbers("CHANGELOG.md", "models,", "formats,", "generators") == made

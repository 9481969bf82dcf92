"""All that the viewer can do, and the test of each: nothing is lost when the page changes hands.

An entry of the sources without a row here, and a row without its test, are failures. `by` says who
answers in a page that computes: "page" itself, "python" with the page's state, or "files".
"""

import inspect
import re
from importlib.resources import files
from pathlib import Path

import pytest

from rastercov.cli import view as command
from rastercov.page.scene import OF_A_RIG

PAGE = files("rastercov.page") / "web"
TESTS = "\n".join(path.read_text("utf-8") for path in Path(__file__).parents[1].rglob("test_*.py"))
KEYS = "test_a_field_never_shows_what_is_not_the_rigs"
FIGURES = "test_edits_give_the_figures_of_rastercov_to_the_last_digit"
SEEN = "test_all_modes_are_reached_and_drawn"
DRAWING = "test_a_drawing_lies_under_the_floor_plan_to_scale_by_two_points"
CALL = "test_a_wrong_call_is_one_line"
OPTIONS = "test_a_result_is_opened_without_its_options"

EDITS = {
    "none": ("page", SEEN),
    "pose": ("page", FIGURES),
    "device": ("page", "test_a_lamp_that_is_moved_lights_other_parts_and_may_go_back"),
    "aim": ("page", "test_aim_turns_the_camera_to_the_point_that_is_clicked"),
    "add": ("page", FIGURES),
    "duplicate": ("page", "test_thresholds_and_views_are_those_of_a_task"),
    "delete": ("page", FIGURES),
    "rename": ("page", KEYS),
    "switch": ("page", "test_headline_and_shares_are_those_of_evaluate"),
    "use": ("page", "test_a_camera_that_is_sold_is_found_by_words_and_taken_by_keys"),
    "camera": ("page", "test_the_lens_of_a_camera_is_changed_and_chosen"),
    "new_camera": ("page", "test_a_saved_rig_is_the_rig"),
    "task": ("page", "test_thresholds_and_views_are_those_of_a_task"),
    "restore": ("page", "test_a_rig_that_was_kept_comes_back"),
    "open": ("page", "test_files_of_cameras_open_as_python_reads_them"),
    "undo": ("page", "test_undo_restores_the_bytes_and_redo_makes_them_again"),
    "redo": ("page", "test_undo_restores_the_bytes_and_redo_makes_them_again"),
    "constraints": ("python", "test_a_place_that_the_plan_moves_is_said"),
    "keep_variant": ("page", "test_variants_keep_a_rig_with_its_figures"),
    "show_variant": ("page", "test_variants_keep_a_rig_with_its_figures"),
    "drop_variant": ("page", "test_variants_keep_a_rig_with_its_figures"),
}
MODES = {
    "reason": ("page", "test_reasons_are_those_of_a_network"),
    "coverage": ("page", "test_levels_of_each_mode_are_those_of_its_figure"),
    "area": ("page", "test_exact_area_is_that_of_the_regions"),
    "camera": ("page", "test_levels_of_each_mode_are_those_of_its_figure"),
    "views": ("page", "test_levels_of_each_mode_are_those_of_its_figure"),
    "density": ("page", "test_levels_of_each_mode_are_those_of_its_figure"),
    "level": ("page", "test_a_level_of_the_standard_is_a_threshold_and_a_colour"),
    "incidence": ("page", "test_the_incidence_is_the_least_of_a_camera_that_covers_the_face"),
    "device": ("page", "test_faces_have_the_colours_of_heads_as_on_a_served_page"),
    "uncertainty": (
        "page", "test_faces_have_the_colours_of_heads_as_on_a_served_page"
    ),
    "angle": ("python", "test_angles_between_views_by_all_pairs"),
    "single": ("python", "test_levels_of_each_mode_are_those_of_its_figure"),
    "segments": ("python", "test_segments_are_those_of_the_thesis"),
    "time": ("python", "test_the_share_of_time_is_that_of_the_report"),
    "lux": ("python", "test_the_map_of_light_is_that_of_the_report"),
}  # fmt: skip
BUTTONS = {
    "Open photograph": "test_clicked_corners_give_the_pose",
    "Undo point": "test_clicked_corners_give_the_pose",
    "Save points": "test_clicked_corners_give_the_pose",
    "Undo": "test_undo_restores_the_bytes_and_redo_makes_them_again",
    "Redo": "test_undo_restores_the_bytes_and_redo_makes_them_again",
    "Copy link": "test_a_link_has_the_rig_to_the_last_bit",
    "Fit": "test_a_page_in_a_frame_fits_the_scene_to_every_size_of_it",
    "Floor plan": "test_a_ring_turns_the_camera_with_the_pointer",
    "Section": "test_sections_and_groups_hide_what_they_cut_away",
    "Measure": "test_a_measure_is_the_distance_of_two_points_that_are_clicked",
    "Aim": "test_aim_turns_the_camera_to_the_point_that_is_clicked",
    "Cameras": SEEN,
    "Handles": SEEN,
    "Handles along camera axes": SEEN,
    "Depth of field": "test_the_blur_circle_reaches_its_limit_at_the_ends_of_the_depth_of_field",
    "Original size": "test_panels_fold_and_stay_so_and_the_image_enlarges",
    "Enlarge": "test_panels_fold_and_stay_so_and_the_image_enlarges",
    "Close": "test_panels_fold_and_stay_so_and_the_image_enlarges",
    "Look through": "test_looking_through_a_camera_shows_what_it_covers",
    "Centre the view on the face": "test_a_click_on_a_face_says_why",
    "Show the constraints": "test_a_place_that_the_plan_moves_is_said",
    "Enforce the constraints of the plan": "test_a_place_that_the_plan_moves_is_said",
    "Download the rig": "test_a_dead_program_is_told_and_nothing_is_lost",
    "Try again": "test_a_dead_program_is_told_and_nothing_is_lost",
    "Restore the rig": "test_another_key_of_the_program_leads_to_its_address",
    "Cancel": "test_work_shows_its_progress_and_can_be_cancelled",
    "Add here": FIGURES,
    "Add one here": "test_an_empty_rig_is_clay_with_a_card_of_ways_to_cameras",
    "Add the best one": "test_an_empty_rig_is_clay_with_a_card_of_ways_to_cameras",
    "Add the best next camera": "test_the_best_next_camera_covers_more_and_can_be_undone",
    "Refine this camera": "test_refining_a_camera_covers_more_and_can_be_undone",
    "Place": "test_an_empty_rig_is_clay_with_a_card_of_ways_to_cameras",
    "Duplicate": "test_thresholds_and_views_are_those_of_a_task",
    "Delete": FIGURES,
    "Copy this type": "test_a_saved_rig_is_the_rig",
    "Keep as variant": "test_variants_keep_a_rig_with_its_figures",
    "Draw exact outlines": "test_why_there_are_no_exact_pieces_is_said",
    "Choose a PNG, JPEG or SVG…": DRAWING,
    "Open a rig, plan or camera…": "test_files_of_cameras_open_as_python_reads_them",
    "Place by two points": DRAWING,
    "Remove": "test_a_drawing_is_saved_with_the_rig_and_comes_back_with_its_scene",
    "Play": "test_play_goes_through_the_frames",
    "Reset to this frame": "test_sliders_of_joints_move_the_robot",
    "End": DRAWING,
    "Start": "test_the_built_in_scenes_open_and_cover",
    "Save rig": "test_a_new_user_gains_ten_points_and_saves_in_three_clicks",
    "Save report": "test_a_saved_rig_or_report_gives_the_same_coverage",
    "Download rig": "test_check_takes_the_saved_files_back_with_the_same_figures",
    "Download thresholds": "test_saved_thresholds_are_read_back",
    "Download plan": "test_check_takes_the_saved_files_back_with_the_same_figures",
    "Download page (one file, opens without rastercov)": (
        "test_the_page_is_downloaded_by_keys_with_what_was_just_typed"
    ),
}
"""Labels of buttons and switches."""
PANELS = {
    "Object": SEEN,
    "Cameras": SEEN,
    "One camera": SEEN,
    "All cameras": SEEN,
    "Why": "test_a_click_on_a_face_says_why",
    "Dead zones": "test_dead_zones_are_those_of_rastercov",
    "Variants": "test_variants_keep_a_rig_with_its_figures",
    "Selected camera": KEYS,
    "Camera type": "test_a_camera_that_is_sold_is_found_by_words_and_taken_by_keys",
    "Camera image": "test_the_image_of_a_camera_has_the_reasons_of_light",
    "What it covers": SEEN,
    "What counts as covered": "test_a_slider_changes_the_summary_to_what_evaluate_says",
    "Goals": "test_goals_are_listed_and_shown_by_their_buttons",
    "Groups": "test_sections_and_groups_hide_what_they_cut_away",
    "Constraints": "test_a_place_that_the_plan_moves_is_said",
    "Segmentation": "test_segments_are_those_of_the_thesis",
    "Time": "test_the_served_page_shows_figures_of_the_frame",
    "Joints": "test_sliders_of_joints_move_the_robot",
    "Rig": KEYS,
}
COMMAND = {
    "sources": OPTIONS,
    "--poses": OPTIONS,
    "--out": "test_a_new_user_gains_ten_points_and_saves_in_three_clicks",
    "--method": CALL,
    "--port": "test_a_port_that_is_taken_is_said",
    "--no-browser": "test_ctrl_c_in_a_request_ends_in_one_line",
    "--export": "test_a_static_page_shows_and_changes_colours_without_a_program",
    "--still": "test_a_result_opens_again_and_its_sheet_has_its_share",
}
"""Options of `view` itself; those that say what a scene is have tests of the scene."""


def text_of(name):
    return (PAGE / f"{name}.js").read_text("utf-8")


def test_each_edit_has_a_row():
    edits = text_of("live_rig").partition("const EDITS = {")[2].partition("\n};")[0]
    own = set(re.findall(r"^  (\w+): (?:ofStation)?\(", edits, re.M))
    steps = set(re.findall(r'do: "(\w+)"', "".join(map(text_of, ("bars", "object_panel")))))
    steps |= set(re.findall(r'do: "(\w+)"', text_of("variants")))
    assert EDITS.keys() >= own | steps


def test_each_mode_button_panel_and_option_has_a_row():
    every = "".join(path.read_text("utf-8") for path in PAGE.iterdir() if path.suffix == ".js")
    assert MODES.keys() >= set(OF_A_RIG)
    labels = re.findall(
        r'\b(?:[bB]utton|fileButton|toggle|check)\(\s*(?:\[sign\("."\), )?"( ?[A-Z][^"]*)"', every
    )
    assert BUTTONS.keys() >= {each.strip() for each in labels}
    assert PANELS.keys() >= set(re.findall(r'\bsection\("([^"]+)"', every))
    text = inspect.getsource(command.view).partition('"""')[0]
    own = {
        each.removesuffix("=")
        for each in re.findall(r"^    (\w+): (?:Annotated|NoBrowser)", text, re.M)
    }
    shown = {"sources", "--poses"} | {f"--{name.replace('_', '-')}" for name in own}
    assert COMMAND.keys() == shown


NAMES = {row[1] for table in (EDITS, MODES) for row in table.values()}
NAMES |= {name for table in (BUTTONS, PANELS, COMMAND) for name in table.values()}


@pytest.mark.parametrize("name", sorted(NAMES))
def test_each_row_has_its_test(name):
    assert f"def {name}(" in TESTS

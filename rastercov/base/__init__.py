"""Helpers without domain words: errors, arguments, files, threads, memory, formats of numbers."""

from importlib import import_module
from typing import TYPE_CHECKING

from rastercov.base.errors import (
    CameraError,
    ConfigError,
    DeviceError,
    MeshError,
    PoseError,
    RastercovError,
    ResourceError,
    errors_as,
)
from rastercov.base.features import hooks_of
from rastercov.base.format import (
    ByName,
    InNotebook,
    InOneLine,
    ReadByName,
    decimals_of,
    first_of,
    frozen_record,
    percent,
    plural,
    sampling,
    shorten,
    shown,
    size_in_words,
    with_bound,
)

if TYPE_CHECKING:
    from rastercov.base.arguments import (
        LARGEST_COORDINATE,
        check_array,
        check_choice,
        check_kind,
        check_limits,
        check_seed,
        finite_number,
        finite_points,
        flag,
        image_side,
        is_one_of,
        members,
    )
    from rastercov.base.files import (
        StrPath,
        UnknownNames,
        UnparsedError,
        UnreadableError,
        Vocabulary,
        file_bytes,
        one_line,
        parse_json,
        printable,
        read_json,
        read_toml,
        suffix_of,
    )
    from rastercov.base.memory import (
        TINY,
        AnyArray,
        BoolArray,
        ByteArray,
        Float32Array,
        FloatArray,
        Int32Array,
        IntArray,
        Lists,
        WholeArray,
        check_memory,
        read_only,
        row_lengths,
    )
    from rastercov.base.output import (
        check_place,
        json_bytes,
        json_text,
        name_file,
        own_folder,
        remove_folder,
        write_bytes,
        write_json,
        write_text,
    )
    from rastercov.base.threads import Closing, Once, once_each, share_poses, thread_count

__all__ = [
    "LARGEST_COORDINATE",
    "TINY",
    "AnyArray",
    "BoolArray",
    "ByName",
    "ByteArray",
    "CameraError",
    "Closing",
    "ConfigError",
    "DeviceError",
    "Float32Array",
    "FloatArray",
    "InNotebook",
    "InOneLine",
    "Int32Array",
    "IntArray",
    "Lists",
    "MeshError",
    "Once",
    "PoseError",
    "RastercovError",
    "ReadByName",
    "ResourceError",
    "StrPath",
    "UnknownNames",
    "UnparsedError",
    "UnreadableError",
    "Vocabulary",
    "WholeArray",
    "check_array",
    "check_choice",
    "check_kind",
    "check_limits",
    "check_memory",
    "check_place",
    "check_seed",
    "decimals_of",
    "errors_as",
    "file_bytes",
    "finite_number",
    "finite_points",
    "first_of",
    "flag",
    "frozen_record",
    "hooks_of",
    "image_side",
    "is_one_of",
    "json_bytes",
    "json_text",
    "members",
    "name_file",
    "once_each",
    "one_line",
    "own_folder",
    "parse_json",
    "percent",
    "plural",
    "printable",
    "read_json",
    "read_only",
    "read_toml",
    "remove_folder",
    "row_lengths",
    "sampling",
    "share_poses",
    "shorten",
    "shown",
    "size_in_words",
    "suffix_of",
    "thread_count",
    "with_bound",
    "write_bytes",
    "write_json",
    "write_text",
]

LATER = ("memory", "arguments", "files", "output", "threads")
"""Modules that load numpy, which `rastercov --help` does without."""

if not TYPE_CHECKING:

    def __getattr__(name):
        """Name of a module that is imported when it is asked for."""
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        modules = (import_module(f"{__name__}.{each}") for each in LATER)
        value = globals()[name] = next(getattr(m, name) for m in modules if hasattr(m, name))
        return value

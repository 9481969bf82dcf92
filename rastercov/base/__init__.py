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
from rastercov.base.features import hooks_of, service_of
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
        check_array,
        check_choice,
        check_kind,
        check_limits,
        check_memory,
        check_seed,
        finite_number,
        finite_points,
        flag,
        image_side,
        is_one_of,
        members,
        offsets_of,
        owners_of,
        read_only,
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
    from rastercov.base.rounded import (
        arccos,
        arcsin,
        arctan2,
        cos,
        dots,
        draw_between,
        hypot,
        matmul,
        norm,
        sin,
        sort_order,
        tan,
    )
    from rastercov.base.threads import Closing, Once, once_each, share_poses, thread_count

LATER = ("arguments", "files", "output", "rounded", "threads")
"""Modules that load numpy, which `rastercov --help` does without."""

if not TYPE_CHECKING:

    def __getattr__(name):
        """Name of a module that is imported when it is asked for."""
        modules = (import_module(f"{__name__}.{each}") for each in LATER)
        value = next((getattr(each, name) for each in modules if hasattr(each, name)), None)
        if value is None:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        globals()[name] = value
        return value

"""Output of a process without the notice that it compiles, which depends on earlier runs."""

NOTICE = "rastercov: compil"


def without_notices(said):
    """Standard error, text or bytes, without the lines that tell of compiling."""
    start = NOTICE if isinstance(said, str) else NOTICE.encode()
    lines = said.splitlines(keepends=True)
    return type(said)().join(line for line in lines if not line.startswith(start))

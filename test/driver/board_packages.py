"""Makes Python packages on the fly that bring boards of their own."""

import textwrap


def install(folder, name, code, entries):
    """Write module ``name`` with what pip leaves beside it: entry points from names to values."""
    (folder / f"{name}.py").write_text(textwrap.dedent(code))
    info = folder / f"{name}-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    lines = [f"{entry} = {value}" for entry, value in entries.items()]
    (info / "entry_points.txt").write_text("[handwave.boards]\n" + "\n".join(lines) + "\n")

"""`daranti convert`: a field's boundary in another format."""

from __future__ import annotations

from pathlib import Path

import click

from host.commands.options import field_option
from host.core.terminal import echo
from host.field.boundary_file import load_field, save_field


@click.command()
@click.argument("source", type=click.Path(path_type=Path))
@click.argument("target", type=click.Path(path_type=Path))
@field_option
def convert(source: Path, target: Path, chosen: str) -> None:
    """Write the field in SOURCE to TARGET; the suffix names the format: .geojson, .kml, .shp, .xml
    (ISOXML), .csv."""
    boundary = load_field(source, chosen)
    save_field(target, boundary)
    echo(
        f"{target}: {boundary.name or 'field'}, {len(boundary.crop)} corners, "
        f"{len(boundary.keep_outs)} keep-outs, {boundary.polygon(boundary.frame).area:.0f} m2"
    )
    if boundary.not_kept_out:
        echo(f"warning: {boundary.not_kept_out}")

"""The meshes of a URDF's links, where they are found."""

from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import numpy as np

from annik_core.errors import AnnikError
from annik_core.files import expanded
from annik_core.installation import ament_prefixes
from annik_core.robots.screw_chain import joint_origin
from annik_core.robots.urdf_text import decoded, parsed
from annik_view.shapes import Mesh

#: Longest file of a mesh that is loaded [bytes].
_LONGEST = 100_000_000


class LinkMesh(NamedTuple):
    """What a link looks like, in the frame of the link."""

    link: str
    mesh: Mesh


def link_meshes(urdf: str | Path) -> list[LinkMesh]:
    """The meshes that a URDF file (.urdf) names for its links; those not found are left out.

    ``package://NAME/...`` is looked for in the folders named so above the file, and in the
    packages of a sourced ROS; a relative name beside the file.
    """
    path = expanded(urdf).absolute()
    if path.suffix != ".urdf":
        return []
    try:
        root = parsed(decoded(path.read_bytes()), str(path))
    except (AnnikError, OSError, ValueError):
        return []
    found = []
    for link in root.findall("link"):
        for visual in link.findall("visual"):
            mesh = _mesh(visual, path)
            if mesh is not None:
                found.append(LinkMesh(link.get("name", ""), mesh))
    return found


def _mesh(visual: ElementTree.Element, urdf: Path) -> Mesh | None:
    element = visual.find("geometry/mesh")
    if element is None:
        return None
    file = _file(element.get("filename", ""), urdf)
    if file is None:
        return None
    import trimesh

    # Its readers raise many kinds of errors for a file that is damaged, or of an unknown kind.
    try:
        loaded: Any = trimesh.load(file, force="mesh")
        scale = np.array([float(number) for number in element.get("scale", "1 1 1").split()])
        origin = joint_origin(visual)
        vertices = np.asarray(loaded.vertices) * scale @ origin[:3, :3].T + origin[:3, 3]
        faces = np.asarray(loaded.faces, dtype=np.uint32)
    except Exception:
        return None
    return Mesh(vertices.astype(np.float32), faces) if len(faces) else None


def _file(name: str, urdf: Path) -> Path | None:
    """The file of a mesh; None if it is not there."""
    if name.startswith("package://"):
        package, _, rest = name.removeprefix("package://").partition("/")
        folders = [
            *(folder for folder in urdf.parents if folder.name == package),
            *(prefix / "share" / package for prefix in ament_prefixes()),
        ]
        candidates = [folder / rest for folder in folders]
    else:
        candidates = [urdf.parent / name.removeprefix("file://")]
    found = (file for file in candidates if file.is_file() and file.stat().st_size <= _LONGEST)
    return next(found, None)

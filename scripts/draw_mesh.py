"""Draws docs/images/scene_mesh.png: `python scripts/draw_mesh.py MESH`.

MESH is a scene as a GLB file, of the sample after 42 s:

    are export out/sample --mesh out/sample/scene.glb --at 42

A ray of each pixel is cast at its triangles, and from there one at a lamp.
"""

import argparse
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

Floats = NDArray[np.float64]
Pixels = NDArray[np.uint8]

_EYE, _LOOKS_AT, _LAMP = (7.6, 11.0, 3.6), (7.6, 0.0, -4.6), (0.45, 1.0, 0.3)
"""In the axes of a GLB, metres: x right, y up, z towards the viewer."""
_FIELD_OF_VIEW_RAD = 0.95
_AMBIENT = 0.4
_LIFT_M = 1e-3
_SKY, _GAMMA = 255.0, 2.2
"""The colours of a GLB are linear."""


def main() -> None:
    """Draw it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("mesh", type=Path)
    parser.add_argument("--out", type=Path, default=Path("docs/images/scene_mesh.png"))
    arguments = parser.parse_args()
    parts = trimesh.load_scene(arguments.mesh).dump()
    colours = np.concatenate(
        [np.tile(part.visual.material.main_color[:3], (len(part.faces), 1)) for part in parts]
    )
    whole = trimesh.util.concatenate([trimesh.Trimesh(p.vertices, p.faces) for p in parts])
    picture = cast_image(whole, colours.astype(np.float64), 2200, 1360)
    Image.fromarray(picture).resize((1100, 680), Image.Resampling.BOX).quantize(64).save(
        arguments.out, optimize=True
    )


def cast_image(
    mesh: trimesh.Trimesh, colours: Floats, width: int, height: int
) -> NDArray[np.uint8]:
    """Return the picture (height, width, 3) of a mesh with a colour (N, 3) for each triangle."""
    eye, lamp = np.array(_EYE), np.array(_LAMP) / np.linalg.norm(_LAMP)
    ahead = np.array(_LOOKS_AT) - eye
    ahead /= np.linalg.norm(ahead)
    right = np.cross(ahead, (0.0, 1.0, 0.0))
    right /= np.linalg.norm(right)
    focal = 0.5 * width / np.tan(0.5 * _FIELD_OF_VIEW_RAD)
    v, u = np.mgrid[:height, :width]
    rays = (
        focal * ahead
        + (u.reshape(-1, 1) - 0.5 * width) * right
        - (v.reshape(-1, 1) - 0.5 * height) * np.cross(right, ahead)
    )
    places, which, faces = mesh.ray.intersects_location(
        np.tile(eye, (len(rays), 1)), rays, multiple_hits=False
    )
    normals = mesh.face_normals[faces]
    normals *= -np.sign((normals * rays[which]).sum(axis=1, keepdims=True))
    facing = np.maximum(normals @ lamp, 0.0)
    is_lit = ~mesh.ray.intersects_any(places + _LIFT_M * normals, np.tile(lamp, (len(places), 1)))
    light = _AMBIENT + (1.0 - _AMBIENT) * facing * is_lit
    picture = np.full((height * width, 3), _SKY)
    picture[which] = colours[faces] * light[:, np.newaxis]
    picture = 255.0 * (picture / 255.0) ** (1.0 / _GAMMA)
    return picture.reshape(height, width, 3).astype(np.uint8)


if __name__ == "__main__":
    main()

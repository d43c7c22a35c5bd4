"""A picture of a recording as rviz would show it: the scene, the map from above, the costmap."""

import warnings
from pathlib import Path

from are_ros.errors import BagError
from are_ros.replay.rviz_scene import RvizScene, read_scene
from are_ros.replay.rviz_views import draw_costmap, draw_perspective, draw_top_down
from are_ros.replay.rviz_window import COSTMAP, MAIN, TOP_DOWN, Window, draw_frame


def draw_rviz(path: Path, png_path: Path, at_s: float | None = None) -> RvizScene:
    """Draw what rviz would show of a recording as PNG; return what was drawn.

    `path` is a replay's output folder, that of a live recording, a rosbag2 folder, or an .mcap or
    .db3 file; `at_s` the time since its beginning, None for the moment when most artefacts are
    perceived near the camera. BagError where there is no such recording or time, or the picture
    cannot be written. The same recording gives the same bytes. Meshes are lit, for the sake of
    their shape: rviz shows the colours of faces unlit.
    """
    import matplotlib as mpl

    scene = read_scene(path, at_s)
    with mpl.rc_context(), warnings.catch_warnings():
        warnings.filterwarnings("ignore", "Glyph")  # labels are the user's, in any script
        mpl.rcdefaults()
        mpl.rcParams["font.family"] = "DejaVu Sans"
        window = Window()
        draw_frame(window, scene, path.resolve().name)
        window.picture(MAIN, draw_perspective(scene, MAIN.size), "Orbit")
        window.picture(TOP_DOWN, draw_top_down(scene, TOP_DOWN.size), "TopDownOrtho")
        window.picture(COSTMAP, draw_costmap(scene, COSTMAP.size), "TopDownOrtho, costmap")
        try:
            window.save(png_path)
        except OSError as cause:
            reason = (cause.strerror or str(cause)).lower()
            message = f"{png_path}: the picture cannot be written ({reason})"
            raise BagError(message) from cause
    return scene

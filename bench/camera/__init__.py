"""A camera that draws what it sees, with OpenCV: pictures, masks, depth and boxes of one SimSpec.

from bench.camera import actors_in, open_camera, pose_of
camera = open_camera(simspec)
frame = camera.capture(pose_of(state, axes_enu), scene.positions(), scene.headings(), number=0)
boxes = actors_in(frame.picture)

This room and bench.perception.pixels import cv2: import them where pixels are wanted, and nowhere else.
"""

from __future__ import annotations

from ._camera import RenderedCamera as RenderedCamera
from ._camera import RenderedFrame as RenderedFrame
from ._camera import actors_in as actors_in
from ._camera import open_camera as open_camera
from ._camera import pose_of as pose_of
from ._camera import stage_of as stage_of
from ._canvas import Canvas as Canvas
from ._conditions import Conditions as Conditions
from ._conditions import Exposure as Exposure
from ._conditions import conditions_of as conditions_of
from ._conditions import exposure_of as exposure_of
from ._conditions import light_of_conditions as light_of_conditions
from ._encoding import decode_depth as decode_depth
from ._encoding import decode_jpeg as decode_jpeg
from ._encoding import decode_mask as decode_mask
from ._encoding import encode_depth as encode_depth
from ._encoding import encode_jpeg as encode_jpeg
from ._encoding import encode_mask as encode_mask
from ._encoding import opencv_build as opencv_build
from ._encoding import small_jpeg as small_jpeg
from ._encoding import use_one_thread as use_one_thread
from ._ground import GroundType as GroundType
from ._looks import look_of as look_of
from ._looks import look_tables as look_tables
from ._renderer import open_opencv_renderer as open_opencv_renderer
from ._view import NEAR_M as NEAR_M
from ._view import actor_axes as actor_axes
from ._view import in_view as in_view
from ._view import reach_m as reach_m

"""The node: images in; detections and states out; services that start and stop.

    ros2 run track_cpu_ros track_cpu --ros-args -r image:=/camera/image_raw
    ros2 service call /track_cpu/start track_cpu_interfaces/srv/Start \\
        "{box: {center: {position: {x: 320, y: 132}}, size_x: 40, size_y: 24}}"

| name | type | |
|---|---|---|
| image | sensor_msgs/Image | bgr8, rgb8, bgra8, rgba8, mono8; the newest only |
| ~/detections | vision_msgs/Detection2DArray | the target while it is believed, else nothing |
| ~/state | track_cpu_interfaces/TargetState | for every image |
| ~/start | track_cpu_interfaces/Start | takes a box of the last image as the target |
| ~/stop | std_srvs/Trigger | forgets the target |

Parameters: model (drmim-p50), precision (f32, int8; empty for the faster one), threads (1),
deadline_ms (0: two searches an image for a lost target), class_id (target).
"""

import rclpy
import track_cpu
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import Image
from std_srvs.srv import Trigger
from track_cpu_interfaces.msg import TargetState
from track_cpu_interfaces.srv import Start
from vision_msgs.msg import BoundingBox2D, Detection2D, Detection2DArray, ObjectHypothesisWithPose

from . import images

# A camera is faster than the tracker now and then: only the newest image counts.
NEWEST = QoSProfile(
    depth=1, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT
)


class TrackCpu(Node):
    def __init__(self):
        super().__init__("track_cpu")
        option = self.declare_parameter
        deadline = option("deadline_ms", 0.0).value
        self.class_id = option("class_id", "target").value
        self.tracker = track_cpu.FlightTracker(
            option("model", track_cpu.builtin_models[0]).value,
            precision=option("precision", "").value or None,
            threads=option("threads", 1).value,
            deadline=1e-3 * deadline if deadline > 0 else None,
        )
        self.last = None  # the last image
        self.taken = None  # when the last tracked image was taken, in seconds
        self.refused = None  # why the last image was, so that it is said once
        self.states = self.create_publisher(TargetState, "~/state", 10)
        self.detections = self.create_publisher(Detection2DArray, "~/detections", 10)
        self.create_subscription(Image, "image", self.see, NEWEST)
        self.create_service(Start, "~/start", self.start)
        self.create_service(Trigger, "~/stop", self.stop)

    def see(self, message):
        self.last = message
        track = None
        if self.tracker.track is not None:
            try:
                track = self.follow(message)
            except ValueError as error:
                if str(error) != self.refused:
                    self.get_logger().warning(f"image refused: {error}")
                self.refused = str(error)
                return
        self.refused = None
        self.publish(message.header, track)

    def follow(self, message):
        pixels = images.array(message)
        now = images.seconds(message)
        elapsed = None
        if now is not None and self.taken is not None and now > self.taken:
            elapsed = now - self.taken
        track = self.tracker(pixels, elapsed=elapsed)
        self.taken = now
        return track

    def publish(self, header, track):
        state = TargetState(header=header, state="idle")
        found = Detection2DArray(header=header)
        if track is not None:
            state.state = track.state
            state.believed = track.ok
            state.presence = track.presence
            state.score = track.score
            state.box = centered(track.box)
        if track is not None and track.ok:
            detection = Detection2D(header=header, bbox=centered(track.box), id="0")
            result = ObjectHypothesisWithPose()
            result.hypothesis.class_id = self.class_id
            result.hypothesis.score = track.presence
            detection.results.append(result)
            found.detections.append(detection)
        self.states.publish(state)
        self.detections.publish(found)

    def start(self, request, response):
        box = corners(request.box)
        response.success = False
        if self.last is None:
            response.message = "no image has arrived"
            return response
        try:
            self.tracker.init(images.array(self.last), box)
        except ValueError as error:
            response.message = str(error)
            return response
        self.taken = images.seconds(self.last)
        response.success = True
        response.message = "left {:g}, top {:g}, width {:g}, height {:g}".format(*box)
        return response

    def stop(self, request, response):
        response.success = self.tracker.track is not None
        response.message = "" if response.success else "no target"
        self.tracker.stop()
        return response


def centered(box):
    """A box as vision_msgs has it."""
    x, y, w, h = box
    found = BoundingBox2D(size_x=w, size_y=h)
    found.center.position.x = x + w / 2
    found.center.position.y = y + h / 2
    return found


def corners(box):
    """Left, top, width and height of a box of vision_msgs."""
    middle = box.center.position
    return middle.x - box.size_x / 2, middle.y - box.size_y / 2, box.size_x, box.size_y


def main():
    rclpy.init()
    node = TrackCpu()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()

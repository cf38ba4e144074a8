//! The messages of MAVLink's common dialect that the station uses, and the checksum seeds of all.
//! Made by `tools/mavlink/make.py`; do not edit.

#![allow(missing_docs, deprecated, non_camel_case_types, unused, clippy::all)]

#[allow(unused_imports)]
use bitflags::{Flags, bitflags};
#[allow(unused_imports)]
use mavlink_core::{
    MavlinkVersion, Message, MessageData, bytes::Bytes, bytes_mut::BytesMut, types::CharArray,
};
#[allow(unused_imports)]
use num_derive::{FromPrimitive, ToPrimitive};
#[allow(unused_imports)]
use num_traits::{FromPrimitive, ToPrimitive};
pub const MINOR_MAVLINK_VERSION: u8 = 3u8;
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct CameraCapFlags: u32 {
        const CAMERA_CAP_FLAGS_CAPTURE_VIDEO = 1;
        const CAMERA_CAP_FLAGS_CAPTURE_IMAGE = 2;
        const CAMERA_CAP_FLAGS_HAS_MODES = 4;
        const CAMERA_CAP_FLAGS_CAN_CAPTURE_IMAGE_IN_VIDEO_MODE = 8;
        const CAMERA_CAP_FLAGS_CAN_CAPTURE_VIDEO_IN_IMAGE_MODE = 16;
        const CAMERA_CAP_FLAGS_HAS_IMAGE_SURVEY_MODE = 32;
        const CAMERA_CAP_FLAGS_HAS_BASIC_ZOOM = 64;
        const CAMERA_CAP_FLAGS_HAS_BASIC_FOCUS = 128;
        const CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM = 256;
        const CAMERA_CAP_FLAGS_HAS_TRACKING_POINT = 512;
        const CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE = 1024;
        const CAMERA_CAP_FLAGS_HAS_TRACKING_GEO_STATUS = 2048;
        const CAMERA_CAP_FLAGS_HAS_THERMAL_RANGE = 4096;
        const CAMERA_CAP_FLAGS_HAS_MTI = 8192;
    }
}
impl CameraCapFlags {
    pub const DEFAULT: Self = Self::CAMERA_CAP_FLAGS_CAPTURE_VIDEO;
}
impl Default for CameraCapFlags {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum CameraMode {
    CAMERA_MODE_IMAGE = 0,
    CAMERA_MODE_VIDEO = 1,
    CAMERA_MODE_IMAGE_SURVEY = 2,
}
impl CameraMode {
    pub const DEFAULT: Self = Self::CAMERA_MODE_IMAGE;
}
impl Default for CameraMode {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum CameraTrackingMode {
    CAMERA_TRACKING_MODE_NONE = 0,
    CAMERA_TRACKING_MODE_POINT = 1,
    CAMERA_TRACKING_MODE_RECTANGLE = 2,
}
impl CameraTrackingMode {
    pub const DEFAULT: Self = Self::CAMERA_TRACKING_MODE_NONE;
}
impl Default for CameraTrackingMode {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct CameraTrackingStatusFlags: u8 {
        const CAMERA_TRACKING_STATUS_FLAGS_IDLE = 0;
        const CAMERA_TRACKING_STATUS_FLAGS_ACTIVE = 1;
        const CAMERA_TRACKING_STATUS_FLAGS_ERROR = 2;
        const CAMERA_TRACKING_STATUS_FLAGS_MTI = 4;
        const CAMERA_TRACKING_STATUS_FLAGS_COASTING = 8;
    }
}
impl CameraTrackingStatusFlags {
    pub const DEFAULT: Self = Self::CAMERA_TRACKING_STATUS_FLAGS_IDLE;
}
impl Default for CameraTrackingStatusFlags {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct CameraTrackingTargetData: u8 {
        const CAMERA_TRACKING_TARGET_DATA_EMBEDDED = 1;
        const CAMERA_TRACKING_TARGET_DATA_RENDERED = 2;
        const CAMERA_TRACKING_TARGET_DATA_IN_STATUS = 4;
    }
}
impl CameraTrackingTargetData {
    pub const DEFAULT: Self = Self::CAMERA_TRACKING_TARGET_DATA_EMBEDDED;
}
impl Default for CameraTrackingTargetData {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct GimbalManagerFlags: u32 {
        const GIMBAL_MANAGER_FLAGS_RETRACT = 1;
        const GIMBAL_MANAGER_FLAGS_NEUTRAL = 2;
        const GIMBAL_MANAGER_FLAGS_ROLL_LOCK = 4;
        const GIMBAL_MANAGER_FLAGS_PITCH_LOCK = 8;
        const GIMBAL_MANAGER_FLAGS_YAW_LOCK = 16;
        const GIMBAL_MANAGER_FLAGS_YAW_IN_VEHICLE_FRAME = 32;
        const GIMBAL_MANAGER_FLAGS_YAW_IN_EARTH_FRAME = 64;
        const GIMBAL_MANAGER_FLAGS_ACCEPTS_YAW_IN_EARTH_FRAME = 128;
        const GIMBAL_MANAGER_FLAGS_RC_EXCLUSIVE = 256;
        const GIMBAL_MANAGER_FLAGS_RC_MIXED = 512;
    }
}
impl GimbalManagerFlags {
    pub const DEFAULT: Self = Self::GIMBAL_MANAGER_FLAGS_RETRACT;
}
impl Default for GimbalManagerFlags {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum LandingTargetType {
    LANDING_TARGET_TYPE_LIGHT_BEACON = 0,
    LANDING_TARGET_TYPE_RADIO_BEACON = 1,
    LANDING_TARGET_TYPE_VISION_FIDUCIAL = 2,
    LANDING_TARGET_TYPE_VISION_OTHER = 3,
}
impl LandingTargetType {
    pub const DEFAULT: Self = Self::LANDING_TARGET_TYPE_LIGHT_BEACON;
}
impl Default for LandingTargetType {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavAutopilot {
    MAV_AUTOPILOT_GENERIC = 0,
    MAV_AUTOPILOT_RESERVED = 1,
    MAV_AUTOPILOT_SLUGS = 2,
    MAV_AUTOPILOT_ARDUPILOTMEGA = 3,
    MAV_AUTOPILOT_OPENPILOT = 4,
    MAV_AUTOPILOT_GENERIC_WAYPOINTS_ONLY = 5,
    MAV_AUTOPILOT_GENERIC_WAYPOINTS_AND_SIMPLE_NAVIGATION_ONLY = 6,
    MAV_AUTOPILOT_GENERIC_MISSION_FULL = 7,
    MAV_AUTOPILOT_INVALID = 8,
    MAV_AUTOPILOT_PPZ = 9,
    MAV_AUTOPILOT_UDB = 10,
    MAV_AUTOPILOT_FP = 11,
    MAV_AUTOPILOT_PX4 = 12,
    MAV_AUTOPILOT_SMACCMPILOT = 13,
    MAV_AUTOPILOT_AUTOQUAD = 14,
    MAV_AUTOPILOT_ARMAZILA = 15,
    MAV_AUTOPILOT_AEROB = 16,
    MAV_AUTOPILOT_ASLUAV = 17,
    MAV_AUTOPILOT_SMARTAP = 18,
    MAV_AUTOPILOT_AIRRAILS = 19,
    MAV_AUTOPILOT_REFLEX = 20,
}
impl MavAutopilot {
    pub const DEFAULT: Self = Self::MAV_AUTOPILOT_GENERIC;
}
impl Default for MavAutopilot {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct MavBool: u16 {
        const MAV_BOOL_FALSE = 0;
        const MAV_BOOL_TRUE = 1;
    }
}
impl MavBool {
    pub const DEFAULT: Self = Self::MAV_BOOL_FALSE;
    pub fn as_bool(&self) -> bool {
        self.contains(Self::MAV_BOOL_TRUE)
    }
}
impl Default for MavBool {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavCmd {
    MAV_CMD_NAV_WAYPOINT = 16,
    MAV_CMD_NAV_LOITER_UNLIM = 17,
    MAV_CMD_NAV_LOITER_TURNS = 18,
    MAV_CMD_NAV_LOITER_TIME = 19,
    MAV_CMD_NAV_RETURN_TO_LAUNCH = 20,
    MAV_CMD_NAV_LAND = 21,
    MAV_CMD_NAV_TAKEOFF = 22,
    MAV_CMD_NAV_LAND_LOCAL = 23,
    MAV_CMD_NAV_TAKEOFF_LOCAL = 24,
    MAV_CMD_NAV_FOLLOW = 25,
    MAV_CMD_NAV_CONTINUE_AND_CHANGE_ALT = 30,
    MAV_CMD_NAV_LOITER_TO_ALT = 31,
    MAV_CMD_DO_FOLLOW = 32,
    MAV_CMD_DO_FOLLOW_REPOSITION = 33,
    MAV_CMD_DO_ORBIT = 34,
    MAV_CMD_DO_FIGURE_EIGHT = 35,
    MAV_CMD_NAV_ARC_WAYPOINT = 36,
    #[deprecated = " See `MAV_CMD_DO_SET_ROI_*` (Superseded since 2018-01)"]
    MAV_CMD_NAV_ROI = 80,
    MAV_CMD_NAV_PATHPLANNING = 81,
    MAV_CMD_NAV_SPLINE_WAYPOINT = 82,
    MAV_CMD_NAV_VTOL_TAKEOFF = 84,
    MAV_CMD_NAV_VTOL_LAND = 85,
    MAV_CMD_NAV_GUIDED_ENABLE = 92,
    MAV_CMD_NAV_DELAY = 93,
    MAV_CMD_NAV_PAYLOAD_PLACE = 94,
    MAV_CMD_NAV_LAST = 95,
    MAV_CMD_CONDITION_DELAY = 112,
    MAV_CMD_CONDITION_CHANGE_ALT = 113,
    MAV_CMD_CONDITION_DISTANCE = 114,
    MAV_CMD_CONDITION_YAW = 115,
    MAV_CMD_CONDITION_LAST = 159,
    MAV_CMD_DO_SET_MODE = 176,
    MAV_CMD_DO_JUMP = 177,
    MAV_CMD_DO_CHANGE_SPEED = 178,
    MAV_CMD_DO_SET_HOME = 179,
    #[deprecated = " See `PARAM_SET` (Deprecated since 2024-04)"]
    MAV_CMD_DO_SET_PARAMETER = 180,
    MAV_CMD_DO_SET_RELAY = 181,
    MAV_CMD_DO_REPEAT_RELAY = 182,
    MAV_CMD_DO_SET_SERVO = 183,
    MAV_CMD_DO_REPEAT_SERVO = 184,
    MAV_CMD_DO_FLIGHTTERMINATION = 185,
    MAV_CMD_DO_CHANGE_ALTITUDE = 186,
    MAV_CMD_DO_SET_ACTUATOR = 187,
    MAV_CMD_DO_RETURN_PATH_START = 188,
    MAV_CMD_DO_LAND_START = 189,
    MAV_CMD_DO_RALLY_LAND = 190,
    MAV_CMD_DO_GO_AROUND = 191,
    MAV_CMD_DO_REPOSITION = 192,
    MAV_CMD_DO_PAUSE_CONTINUE = 193,
    MAV_CMD_DO_SET_REVERSE = 194,
    MAV_CMD_DO_SET_ROI_LOCATION = 195,
    MAV_CMD_DO_SET_ROI_WPNEXT_OFFSET = 196,
    MAV_CMD_DO_SET_ROI_NONE = 197,
    MAV_CMD_DO_SET_ROI_SYSID = 198,
    MAV_CMD_DO_CONTROL_VIDEO = 200,
    #[deprecated = " See `MAV_CMD_DO_SET_ROI_*` (Superseded since 2018-01)"]
    MAV_CMD_DO_SET_ROI = 201,
    MAV_CMD_DO_DIGICAM_CONFIGURE = 202,
    MAV_CMD_DO_DIGICAM_CONTROL = 203,
    #[deprecated = "The message can still be used to communicate with legacy gimbals implementing it. See `MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE` (Superseded since 2020-01)"]
    MAV_CMD_DO_MOUNT_CONFIGURE = 204,
    #[deprecated = "This message is ambiguous and inconsistent. It has been superseded by MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW and `MAV_CMD_DO_SET_ROI_*` variants. The message can still be used to communicate with legacy gimbals implementing it. See `MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW` (Superseded since 2020-01)"]
    MAV_CMD_DO_MOUNT_CONTROL = 205,
    MAV_CMD_DO_SET_CAM_TRIGG_DIST = 206,
    MAV_CMD_DO_FENCE_ENABLE = 207,
    MAV_CMD_DO_PARACHUTE = 208,
    MAV_CMD_DO_MOTOR_TEST = 209,
    MAV_CMD_DO_INVERTED_FLIGHT = 210,
    MAV_CMD_DO_GRIPPER = 211,
    MAV_CMD_DO_AUTOTUNE_ENABLE = 212,
    MAV_CMD_NAV_SET_YAW_SPEED = 213,
    MAV_CMD_DO_SET_CAM_TRIGG_INTERVAL = 214,
    #[deprecated = " See `MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW` (Superseded since 2020-01)"]
    MAV_CMD_DO_MOUNT_CONTROL_QUAT = 220,
    MAV_CMD_DO_GUIDED_MASTER = 221,
    MAV_CMD_DO_GUIDED_LIMITS = 222,
    MAV_CMD_DO_ENGINE_CONTROL = 223,
    MAV_CMD_DO_SET_MISSION_CURRENT = 224,
    MAV_CMD_DO_LAST = 240,
    MAV_CMD_PREFLIGHT_CALIBRATION = 241,
    MAV_CMD_PREFLIGHT_SET_SENSOR_OFFSETS = 242,
    MAV_CMD_PREFLIGHT_UAVCAN = 243,
    MAV_CMD_PREFLIGHT_STORAGE = 245,
    MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN = 246,
    MAV_CMD_OVERRIDE_GOTO = 252,
    MAV_CMD_OBLIQUE_SURVEY = 260,
    MAV_CMD_DO_SET_STANDARD_MODE = 262,
    MAV_CMD_MISSION_START = 300,
    MAV_CMD_ACTUATOR_TEST = 310,
    MAV_CMD_CONFIGURE_ACTUATOR = 311,
    MAV_CMD_COMPONENT_ARM_DISARM = 400,
    MAV_CMD_RUN_PREARM_CHECKS = 401,
    MAV_CMD_ILLUMINATOR_ON_OFF = 405,
    MAV_CMD_DO_ILLUMINATOR_CONFIGURE = 406,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2022-04)"]
    MAV_CMD_GET_HOME_POSITION = 410,
    MAV_CMD_INJECT_FAILURE = 420,
    MAV_CMD_START_RX_PAIR = 500,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2022-04)"]
    MAV_CMD_GET_MESSAGE_INTERVAL = 510,
    MAV_CMD_SET_MESSAGE_INTERVAL = 511,
    MAV_CMD_REQUEST_MESSAGE = 512,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Deprecated since 2025-11)"]
    MAV_CMD_REQUEST_PROTOCOL_VERSION = 519,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_AUTOPILOT_CAPABILITIES = 520,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_CAMERA_INFORMATION = 521,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_CAMERA_SETTINGS = 522,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_STORAGE_INFORMATION = 525,
    MAV_CMD_STORAGE_FORMAT = 526,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_CAMERA_CAPTURE_STATUS = 527,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_FLIGHT_INFORMATION = 528,
    MAV_CMD_RESET_CAMERA_SETTINGS = 529,
    MAV_CMD_SET_CAMERA_MODE = 530,
    MAV_CMD_SET_CAMERA_ZOOM = 531,
    MAV_CMD_SET_CAMERA_FOCUS = 532,
    MAV_CMD_SET_STORAGE_USAGE = 533,
    MAV_CMD_SET_CAMERA_SOURCE = 534,
    MAV_CMD_JUMP_TAG = 600,
    MAV_CMD_DO_JUMP_TAG = 601,
    MAV_CMD_DO_SET_GLOBAL_ORIGIN = 611,
    MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW = 1000,
    MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE = 1001,
    MAV_CMD_IMAGE_START_CAPTURE = 2000,
    MAV_CMD_IMAGE_STOP_CAPTURE = 2001,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_CAMERA_IMAGE_CAPTURE = 2002,
    MAV_CMD_DO_TRIGGER_CONTROL = 2003,
    MAV_CMD_CAMERA_TRACK_POINT = 2004,
    MAV_CMD_CAMERA_TRACK_RECTANGLE = 2005,
    MAV_CMD_CAMERA_STOP_TRACKING = 2010,
    MAV_CMD_VIDEO_START_CAPTURE = 2500,
    MAV_CMD_VIDEO_STOP_CAPTURE = 2501,
    MAV_CMD_VIDEO_START_STREAMING = 2502,
    MAV_CMD_VIDEO_STOP_STREAMING = 2503,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_VIDEO_STREAM_INFORMATION = 2504,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2019-08)"]
    MAV_CMD_REQUEST_VIDEO_STREAM_STATUS = 2505,
    MAV_CMD_LOGGING_START = 2510,
    MAV_CMD_LOGGING_STOP = 2511,
    MAV_CMD_AIRFRAME_CONFIGURATION = 2520,
    MAV_CMD_CONTROL_HIGH_LATENCY = 2600,
    MAV_CMD_PANORAMA_CREATE = 2800,
    MAV_CMD_DO_VTOL_TRANSITION = 3000,
    MAV_CMD_ARM_AUTHORIZATION_REQUEST = 3001,
    MAV_CMD_SET_GUIDED_SUBMODE_STANDARD = 4000,
    MAV_CMD_SET_GUIDED_SUBMODE_CIRCLE = 4001,
    MAV_CMD_CONDITION_GATE = 4501,
    MAV_CMD_NAV_FENCE_RETURN_POINT = 5000,
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION = 5001,
    MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION = 5002,
    MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION = 5003,
    MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION = 5004,
    MAV_CMD_NAV_RALLY_POINT = 5100,
    #[deprecated = " See `MAV_CMD_REQUEST_MESSAGE` (Superseded since 2026-05)"]
    MAV_CMD_UAVCAN_GET_NODE_INFO = 5200,
    MAV_CMD_DO_SET_SAFETY_SWITCH_STATE = 5300,
    MAV_CMD_DO_ADSB_OUT_IDENT = 10001,
    #[deprecated = " See `` (Superseded since 2021-06)"]
    MAV_CMD_PAYLOAD_PREPARE_DEPLOY = 30001,
    #[deprecated = " See `` (Superseded since 2021-06)"]
    MAV_CMD_PAYLOAD_CONTROL_DEPLOY = 30002,
    MAV_CMD_FIXED_MAG_CAL_YAW = 42006,
    MAV_CMD_DO_WINCH = 42600,
    MAV_CMD_GUIDED_CHANGE_SPEED = 43000,
    MAV_CMD_GUIDED_CHANGE_ALTITUDE = 43001,
    MAV_CMD_GUIDED_CHANGE_HEADING = 43002,
    MAV_CMD_EXTERNAL_POSITION_ESTIMATE = 43003,
    MAV_CMD_WAYPOINT_USER_1 = 31000,
    MAV_CMD_WAYPOINT_USER_2 = 31001,
    MAV_CMD_WAYPOINT_USER_3 = 31002,
    MAV_CMD_WAYPOINT_USER_4 = 31003,
    MAV_CMD_WAYPOINT_USER_5 = 31004,
    MAV_CMD_SPATIAL_USER_1 = 31005,
    MAV_CMD_SPATIAL_USER_2 = 31006,
    MAV_CMD_SPATIAL_USER_3 = 31007,
    MAV_CMD_SPATIAL_USER_4 = 31008,
    MAV_CMD_SPATIAL_USER_5 = 31009,
    MAV_CMD_USER_1 = 31010,
    MAV_CMD_USER_2 = 31011,
    MAV_CMD_USER_3 = 31012,
    MAV_CMD_USER_4 = 31013,
    MAV_CMD_USER_5 = 31014,
    MAV_CMD_CAN_FORWARD = 32000,
}
impl MavCmd {
    pub const DEFAULT: Self = Self::MAV_CMD_NAV_WAYPOINT;
}
impl Default for MavCmd {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavFrame {
    MAV_FRAME_GLOBAL = 0,
    MAV_FRAME_LOCAL_NED = 1,
    MAV_FRAME_MISSION = 2,
    MAV_FRAME_GLOBAL_RELATIVE_ALT = 3,
    MAV_FRAME_LOCAL_ENU = 4,
    #[deprecated = "Use MAV_FRAME_GLOBAL in COMMAND_INT (and elsewhere) as a synonymous replacement. See `MAV_FRAME_GLOBAL` (Superseded since 2024-03)"]
    MAV_FRAME_GLOBAL_INT = 5,
    #[deprecated = "Use MAV_FRAME_GLOBAL_RELATIVE_ALT in COMMAND_INT (and elsewhere) as a synonymous replacement. See `MAV_FRAME_GLOBAL_RELATIVE_ALT` (Superseded since 2024-03)"]
    MAV_FRAME_GLOBAL_RELATIVE_ALT_INT = 6,
    MAV_FRAME_LOCAL_OFFSET_NED = 7,
    #[deprecated = " See `MAV_FRAME_BODY_FRD` (Superseded since 2019-08)"]
    MAV_FRAME_BODY_NED = 8,
    #[deprecated = " See `MAV_FRAME_BODY_FRD` (Superseded since 2019-08)"]
    MAV_FRAME_BODY_OFFSET_NED = 9,
    MAV_FRAME_GLOBAL_TERRAIN_ALT = 10,
    #[deprecated = "Use MAV_FRAME_GLOBAL_TERRAIN_ALT in COMMAND_INT (and elsewhere) as a synonymous replacement. See `MAV_FRAME_GLOBAL_TERRAIN_ALT` (Superseded since 2024-03)"]
    MAV_FRAME_GLOBAL_TERRAIN_ALT_INT = 11,
    MAV_FRAME_BODY_FRD = 12,
    #[deprecated = "  (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_13 = 13,
    #[deprecated = " See `MAV_FRAME_LOCAL_FRD` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_14 = 14,
    #[deprecated = " See `MAV_FRAME_LOCAL_FLU` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_15 = 15,
    #[deprecated = " See `MAV_FRAME_LOCAL_FRD` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_16 = 16,
    #[deprecated = " See `MAV_FRAME_LOCAL_FLU` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_17 = 17,
    #[deprecated = " See `MAV_FRAME_LOCAL_FRD` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_18 = 18,
    #[deprecated = " See `MAV_FRAME_LOCAL_FLU` (Deprecated since 2019-04)"]
    MAV_FRAME_RESERVED_19 = 19,
    MAV_FRAME_LOCAL_FRD = 20,
    MAV_FRAME_LOCAL_FLU = 21,
}
impl MavFrame {
    pub const DEFAULT: Self = Self::MAV_FRAME_GLOBAL;
}
impl Default for MavFrame {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct MavModeFlag: u8 {
        const MAV_MODE_FLAG_SAFETY_ARMED = 128;
        const MAV_MODE_FLAG_MANUAL_INPUT_ENABLED = 64;
        const MAV_MODE_FLAG_HIL_ENABLED = 32;
        const MAV_MODE_FLAG_STABILIZE_ENABLED = 16;
        const MAV_MODE_FLAG_GUIDED_ENABLED = 8;
        const MAV_MODE_FLAG_AUTO_ENABLED = 4;
        const MAV_MODE_FLAG_TEST_ENABLED = 2;
        const MAV_MODE_FLAG_CUSTOM_MODE_ENABLED = 1;
    }
}
impl MavModeFlag {
    pub const DEFAULT: Self = Self::MAV_MODE_FLAG_SAFETY_ARMED;
}
impl Default for MavModeFlag {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavResult {
    MAV_RESULT_ACCEPTED = 0,
    MAV_RESULT_TEMPORARILY_REJECTED = 1,
    MAV_RESULT_DENIED = 2,
    MAV_RESULT_UNSUPPORTED = 3,
    MAV_RESULT_FAILED = 4,
    MAV_RESULT_IN_PROGRESS = 5,
    MAV_RESULT_CANCELLED = 6,
    MAV_RESULT_COMMAND_LONG_ONLY = 7,
    MAV_RESULT_COMMAND_INT_ONLY = 8,
    MAV_RESULT_COMMAND_UNSUPPORTED_MAV_FRAME = 9,
    MAV_RESULT_NOT_IN_CONTROL = 10,
}
impl MavResult {
    pub const DEFAULT: Self = Self::MAV_RESULT_ACCEPTED;
}
impl Default for MavResult {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavState {
    MAV_STATE_UNINIT = 0,
    MAV_STATE_BOOT = 1,
    MAV_STATE_CALIBRATING = 2,
    MAV_STATE_STANDBY = 3,
    MAV_STATE_ACTIVE = 4,
    MAV_STATE_CRITICAL = 5,
    MAV_STATE_EMERGENCY = 6,
    MAV_STATE_POWEROFF = 7,
    MAV_STATE_FLIGHT_TERMINATION = 8,
}
impl MavState {
    pub const DEFAULT: Self = Self::MAV_STATE_UNINIT;
}
impl Default for MavState {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum MavType {
    MAV_TYPE_GENERIC = 0,
    MAV_TYPE_FIXED_WING = 1,
    MAV_TYPE_QUADROTOR = 2,
    MAV_TYPE_COAXIAL = 3,
    MAV_TYPE_HELICOPTER = 4,
    MAV_TYPE_ANTENNA_TRACKER = 5,
    MAV_TYPE_GCS = 6,
    MAV_TYPE_AIRSHIP = 7,
    MAV_TYPE_FREE_BALLOON = 8,
    MAV_TYPE_ROCKET = 9,
    MAV_TYPE_GROUND_ROVER = 10,
    MAV_TYPE_SURFACE_BOAT = 11,
    MAV_TYPE_SUBMARINE = 12,
    MAV_TYPE_HEXAROTOR = 13,
    MAV_TYPE_OCTOROTOR = 14,
    MAV_TYPE_TRICOPTER = 15,
    MAV_TYPE_FLAPPING_WING = 16,
    MAV_TYPE_KITE = 17,
    MAV_TYPE_ONBOARD_CONTROLLER = 18,
    MAV_TYPE_VTOL_TAILSITTER_DUOROTOR = 19,
    MAV_TYPE_VTOL_TAILSITTER_QUADROTOR = 20,
    MAV_TYPE_VTOL_TILTROTOR = 21,
    MAV_TYPE_VTOL_FIXEDROTOR = 22,
    MAV_TYPE_VTOL_TAILSITTER = 23,
    MAV_TYPE_VTOL_TILTWING = 24,
    MAV_TYPE_VTOL_RESERVED5 = 25,
    MAV_TYPE_GIMBAL = 26,
    MAV_TYPE_ADSB = 27,
    MAV_TYPE_PARAFOIL = 28,
    MAV_TYPE_DODECAROTOR = 29,
    MAV_TYPE_CAMERA = 30,
    MAV_TYPE_CHARGING_STATION = 31,
    MAV_TYPE_FLARM = 32,
    MAV_TYPE_SERVO = 33,
    MAV_TYPE_ODID = 34,
    MAV_TYPE_DECAROTOR = 35,
    MAV_TYPE_BATTERY = 36,
    MAV_TYPE_PARACHUTE = 37,
    MAV_TYPE_LOG = 38,
    MAV_TYPE_OSD = 39,
    MAV_TYPE_IMU = 40,
    MAV_TYPE_GPS = 41,
    MAV_TYPE_WINCH = 42,
    MAV_TYPE_GENERIC_MULTIROTOR = 43,
    MAV_TYPE_ILLUMINATOR = 44,
    MAV_TYPE_SPACECRAFT_ORBITER = 45,
    MAV_TYPE_GROUND_QUADRUPED = 46,
    MAV_TYPE_VTOL_GYRODYNE = 47,
    MAV_TYPE_GRIPPER = 48,
    MAV_TYPE_RADIO = 49,
}
impl MavType {
    pub const DEFAULT: Self = Self::MAV_TYPE_GENERIC;
}
impl Default for MavType {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum StorageStatus {
    STORAGE_STATUS_EMPTY = 0,
    STORAGE_STATUS_UNFORMATTED = 1,
    STORAGE_STATUS_READY = 2,
    STORAGE_STATUS_NOT_SUPPORTED = 3,
}
impl StorageStatus {
    pub const DEFAULT: Self = Self::STORAGE_STATUS_EMPTY;
}
impl Default for StorageStatus {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum StorageType {
    STORAGE_TYPE_UNKNOWN = 0,
    STORAGE_TYPE_USB_STICK = 1,
    STORAGE_TYPE_SD = 2,
    STORAGE_TYPE_MICROSD = 3,
    STORAGE_TYPE_CF = 4,
    STORAGE_TYPE_CFE = 5,
    STORAGE_TYPE_XQD = 6,
    STORAGE_TYPE_HD = 7,
    STORAGE_TYPE_OTHER = 254,
}
impl StorageType {
    pub const DEFAULT: Self = Self::STORAGE_TYPE_UNKNOWN;
}
impl Default for StorageType {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct StorageUsageFlag: u16 {
        const STORAGE_USAGE_FLAG_SET = 1;
        const STORAGE_USAGE_FLAG_PHOTO = 2;
        const STORAGE_USAGE_FLAG_VIDEO = 4;
        const STORAGE_USAGE_FLAG_LOGS = 8;
    }
}
impl StorageUsageFlag {
    pub const DEFAULT: Self = Self::STORAGE_USAGE_FLAG_SET;
}
impl Default for StorageUsageFlag {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum VideoStreamEncoding {
    VIDEO_STREAM_ENCODING_UNKNOWN = 0,
    VIDEO_STREAM_ENCODING_H264 = 1,
    VIDEO_STREAM_ENCODING_H265 = 2,
}
impl VideoStreamEncoding {
    pub const DEFAULT: Self = Self::VIDEO_STREAM_ENCODING_UNKNOWN;
}
impl Default for VideoStreamEncoding {
    fn default() -> Self {
        Self::DEFAULT
    }
}
bitflags! {
    #[derive(Debug, Copy, Clone, PartialEq)]
    pub struct VideoStreamStatusFlags: u16 {
        const VIDEO_STREAM_STATUS_FLAGS_RUNNING = 1;
        const VIDEO_STREAM_STATUS_FLAGS_THERMAL = 2;
        const VIDEO_STREAM_STATUS_FLAGS_THERMAL_RANGE_ENABLED = 4;
    }
}
impl VideoStreamStatusFlags {
    pub const DEFAULT: Self = Self::VIDEO_STREAM_STATUS_FLAGS_RUNNING;
}
impl Default for VideoStreamStatusFlags {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[derive(Debug, Copy, Clone, PartialEq, FromPrimitive, ToPrimitive)]
#[repr(u32)]
pub enum VideoStreamType {
    VIDEO_STREAM_TYPE_RTSP = 0,
    VIDEO_STREAM_TYPE_RTPUDP = 1,
    VIDEO_STREAM_TYPE_TCP_MPEG = 2,
    VIDEO_STREAM_TYPE_MPEG_TS = 3,
    VIDEO_STREAM_TYPE_WHEP = 4,
}
impl VideoStreamType {
    pub const DEFAULT: Self = Self::VIDEO_STREAM_TYPE_RTSP;
}
impl Default for VideoStreamType {
    fn default() -> Self {
        Self::DEFAULT
    }
}
#[doc = "ID: 262"]
#[derive(Debug, Clone, PartialEq)]
pub struct CAMERA_CAPTURE_STATUS_DATA {
    pub time_boot_ms: u32,
    pub image_interval: f32,
    pub recording_time_ms: u32,
    pub available_capacity: f32,
    pub image_status: u8,
    pub video_status: u8,
}
impl CAMERA_CAPTURE_STATUS_DATA {
    pub const ENCODED_LEN: usize = 18usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        image_interval: 0.0_f32,
        recording_time_ms: 0_u32,
        available_capacity: 0.0_f32,
        image_status: 0_u8,
        video_status: 0_u8,
    };
}
impl Default for CAMERA_CAPTURE_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for CAMERA_CAPTURE_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 262u32;
    const NAME: &'static str = "CAMERA_CAPTURE_STATUS";
    const EXTRA_CRC: u8 = 12u8;
    const ENCODED_LEN: usize = 18usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.image_interval = buf.get_f32_le()?;
        __struct.recording_time_ms = buf.get_u32_le()?;
        __struct.available_capacity = buf.get_f32_le()?;
        __struct.image_status = buf.get_u8()?;
        __struct.video_status = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_f32_le(self.image_interval);
        __tmp.put_u32_le(self.recording_time_ms);
        __tmp.put_f32_le(self.available_capacity);
        __tmp.put_u8(self.image_status);
        __tmp.put_u8(self.video_status);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 259"]
#[derive(Debug, Clone, PartialEq)]
pub struct CAMERA_INFORMATION_DATA {
    pub time_boot_ms: u32,
    pub firmware_version: u32,
    pub focal_length: f32,
    pub sensor_size_h: f32,
    pub sensor_size_v: f32,
    pub flags: CameraCapFlags,
    pub resolution_h: u16,
    pub resolution_v: u16,
    pub cam_definition_version: u16,
    pub vendor_name: [u8; 32],
    pub model_name: [u8; 32],
    pub lens_id: u8,
    pub cam_definition_uri: CharArray<140>,
}
impl CAMERA_INFORMATION_DATA {
    pub const ENCODED_LEN: usize = 235usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        firmware_version: 0_u32,
        focal_length: 0.0_f32,
        sensor_size_h: 0.0_f32,
        sensor_size_v: 0.0_f32,
        flags: CameraCapFlags::DEFAULT,
        resolution_h: 0_u16,
        resolution_v: 0_u16,
        cam_definition_version: 0_u16,
        vendor_name: [0_u8; 32usize],
        model_name: [0_u8; 32usize],
        lens_id: 0_u8,
        cam_definition_uri: CharArray::new([0_u8; 140usize]),
    };
}
impl Default for CAMERA_INFORMATION_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for CAMERA_INFORMATION_DATA {
    type Message = MavMessage;
    const ID: u32 = 259u32;
    const NAME: &'static str = "CAMERA_INFORMATION";
    const EXTRA_CRC: u8 = 92u8;
    const ENCODED_LEN: usize = 235usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.firmware_version = buf.get_u32_le()?;
        __struct.focal_length = buf.get_f32_le()?;
        __struct.sensor_size_h = buf.get_f32_le()?;
        __struct.sensor_size_v = buf.get_f32_le()?;
        let tmp = buf.get_u32_le()?;
        __struct.flags = CameraCapFlags::from_bits_retain(tmp as <CameraCapFlags as Flags>::Bits);
        __struct.resolution_h = buf.get_u16_le()?;
        __struct.resolution_v = buf.get_u16_le()?;
        __struct.cam_definition_version = buf.get_u16_le()?;
        for v in &mut __struct.vendor_name {
            let val = buf.get_u8()?;
            *v = val;
        }
        for v in &mut __struct.model_name {
            let val = buf.get_u8()?;
            *v = val;
        }
        __struct.lens_id = buf.get_u8()?;
        let mut tmp = [0_u8; 140usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.cam_definition_uri = CharArray::new(tmp);
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_u32_le(self.firmware_version);
        __tmp.put_f32_le(self.focal_length);
        __tmp.put_f32_le(self.sensor_size_h);
        __tmp.put_f32_le(self.sensor_size_v);
        __tmp.put_u32_le(self.flags.bits() as u32);
        __tmp.put_u16_le(self.resolution_h);
        __tmp.put_u16_le(self.resolution_v);
        __tmp.put_u16_le(self.cam_definition_version);
        for val in &self.vendor_name {
            __tmp.put_u8(*val);
        }
        for val in &self.model_name {
            __tmp.put_u8(*val);
        }
        __tmp.put_u8(self.lens_id);
        for val in &self.cam_definition_uri {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 260"]
#[derive(Debug, Clone, PartialEq)]
pub struct CAMERA_SETTINGS_DATA {
    pub time_boot_ms: u32,
    pub mode_id: CameraMode,
}
impl CAMERA_SETTINGS_DATA {
    pub const ENCODED_LEN: usize = 5usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        mode_id: CameraMode::DEFAULT,
    };
}
impl Default for CAMERA_SETTINGS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for CAMERA_SETTINGS_DATA {
    type Message = MavMessage;
    const ID: u32 = 260u32;
    const NAME: &'static str = "CAMERA_SETTINGS";
    const EXTRA_CRC: u8 = 146u8;
    const ENCODED_LEN: usize = 5usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        let tmp = buf.get_u8()?;
        __struct.mode_id =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "CameraMode",
                value: tmp as u64,
            })?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_u8(self.mode_id as u8);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 275"]
#[derive(Debug, Clone, PartialEq)]
pub struct CAMERA_TRACKING_IMAGE_STATUS_DATA {
    pub point_x: f32,
    pub point_y: f32,
    pub radius: f32,
    pub rec_top_x: f32,
    pub rec_top_y: f32,
    pub rec_bottom_x: f32,
    pub rec_bottom_y: f32,
    pub tracking_status: CameraTrackingStatusFlags,
    pub tracking_mode: CameraTrackingMode,
    pub target_data: CameraTrackingTargetData,
}
impl CAMERA_TRACKING_IMAGE_STATUS_DATA {
    pub const ENCODED_LEN: usize = 31usize;
    pub const DEFAULT: Self = Self {
        point_x: 0.0_f32,
        point_y: 0.0_f32,
        radius: 0.0_f32,
        rec_top_x: 0.0_f32,
        rec_top_y: 0.0_f32,
        rec_bottom_x: 0.0_f32,
        rec_bottom_y: 0.0_f32,
        tracking_status: CameraTrackingStatusFlags::DEFAULT,
        tracking_mode: CameraTrackingMode::DEFAULT,
        target_data: CameraTrackingTargetData::DEFAULT,
    };
}
impl Default for CAMERA_TRACKING_IMAGE_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for CAMERA_TRACKING_IMAGE_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 275u32;
    const NAME: &'static str = "CAMERA_TRACKING_IMAGE_STATUS";
    const EXTRA_CRC: u8 = 126u8;
    const ENCODED_LEN: usize = 31usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.point_x = buf.get_f32_le()?;
        __struct.point_y = buf.get_f32_le()?;
        __struct.radius = buf.get_f32_le()?;
        __struct.rec_top_x = buf.get_f32_le()?;
        __struct.rec_top_y = buf.get_f32_le()?;
        __struct.rec_bottom_x = buf.get_f32_le()?;
        __struct.rec_bottom_y = buf.get_f32_le()?;
        let tmp = buf.get_u8()?;
        __struct.tracking_status = CameraTrackingStatusFlags::from_bits_retain(
            tmp as <CameraTrackingStatusFlags as Flags>::Bits,
        );
        let tmp = buf.get_u8()?;
        __struct.tracking_mode =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "CameraTrackingMode",
                value: tmp as u64,
            })?;
        let tmp = buf.get_u8()?;
        __struct.target_data = CameraTrackingTargetData::from_bits_retain(
            tmp as <CameraTrackingTargetData as Flags>::Bits,
        );
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.point_x);
        __tmp.put_f32_le(self.point_y);
        __tmp.put_f32_le(self.radius);
        __tmp.put_f32_le(self.rec_top_x);
        __tmp.put_f32_le(self.rec_top_y);
        __tmp.put_f32_le(self.rec_bottom_x);
        __tmp.put_f32_le(self.rec_bottom_y);
        __tmp.put_u8(self.tracking_status.bits() as u8);
        __tmp.put_u8(self.tracking_mode as u8);
        __tmp.put_u8(self.target_data.bits() as u8);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 77"]
#[derive(Debug, Clone, PartialEq)]
pub struct COMMAND_ACK_DATA {
    pub command: MavCmd,
    pub result: MavResult,
}
impl COMMAND_ACK_DATA {
    pub const ENCODED_LEN: usize = 3usize;
    pub const DEFAULT: Self = Self {
        command: MavCmd::DEFAULT,
        result: MavResult::DEFAULT,
    };
}
impl Default for COMMAND_ACK_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_ACK_DATA {
    type Message = MavMessage;
    const ID: u32 = 77u32;
    const NAME: &'static str = "COMMAND_ACK";
    const EXTRA_CRC: u8 = 143u8;
    const ENCODED_LEN: usize = 3usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        let tmp = buf.get_u16_le()?;
        __struct.command = FromPrimitive::from_u16(tmp).ok_or(
            ::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavCmd",
                value: tmp as u64,
            },
        )?;
        let tmp = buf.get_u8()?;
        __struct.result =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavResult",
                value: tmp as u64,
            })?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u16_le(self.command as u16);
        __tmp.put_u8(self.result as u8);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 75"]
#[derive(Debug, Clone, PartialEq)]
pub struct COMMAND_INT_DATA {
    pub param1: f32,
    pub param2: f32,
    pub param3: f32,
    pub param4: f32,
    pub x: i32,
    pub y: i32,
    pub z: f32,
    pub command: MavCmd,
    pub target_system: u8,
    pub target_component: u8,
    pub frame: MavFrame,
    pub current: u8,
    pub autocontinue: u8,
}
impl COMMAND_INT_DATA {
    pub const ENCODED_LEN: usize = 35usize;
    pub const DEFAULT: Self = Self {
        param1: 0.0_f32,
        param2: 0.0_f32,
        param3: 0.0_f32,
        param4: 0.0_f32,
        x: 0_i32,
        y: 0_i32,
        z: 0.0_f32,
        command: MavCmd::DEFAULT,
        target_system: 0_u8,
        target_component: 0_u8,
        frame: MavFrame::DEFAULT,
        current: 0_u8,
        autocontinue: 0_u8,
    };
}
impl Default for COMMAND_INT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_INT_DATA {
    type Message = MavMessage;
    const ID: u32 = 75u32;
    const NAME: &'static str = "COMMAND_INT";
    const EXTRA_CRC: u8 = 158u8;
    const ENCODED_LEN: usize = 35usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param1 = buf.get_f32_le()?;
        __struct.param2 = buf.get_f32_le()?;
        __struct.param3 = buf.get_f32_le()?;
        __struct.param4 = buf.get_f32_le()?;
        __struct.x = buf.get_i32_le()?;
        __struct.y = buf.get_i32_le()?;
        __struct.z = buf.get_f32_le()?;
        let tmp = buf.get_u16_le()?;
        __struct.command = FromPrimitive::from_u16(tmp).ok_or(
            ::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavCmd",
                value: tmp as u64,
            },
        )?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        let tmp = buf.get_u8()?;
        __struct.frame =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavFrame",
                value: tmp as u64,
            })?;
        __struct.current = buf.get_u8()?;
        __struct.autocontinue = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param1);
        __tmp.put_f32_le(self.param2);
        __tmp.put_f32_le(self.param3);
        __tmp.put_f32_le(self.param4);
        __tmp.put_i32_le(self.x);
        __tmp.put_i32_le(self.y);
        __tmp.put_f32_le(self.z);
        __tmp.put_u16_le(self.command as u16);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        __tmp.put_u8(self.frame as u8);
        __tmp.put_u8(self.current);
        __tmp.put_u8(self.autocontinue);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 76"]
#[derive(Debug, Clone, PartialEq)]
pub struct COMMAND_LONG_DATA {
    pub param1: f32,
    pub param2: f32,
    pub param3: f32,
    pub param4: f32,
    pub param5: f32,
    pub param6: f32,
    pub param7: f32,
    pub command: MavCmd,
    pub target_system: u8,
    pub target_component: u8,
    pub confirmation: u8,
}
impl COMMAND_LONG_DATA {
    pub const ENCODED_LEN: usize = 33usize;
    pub const DEFAULT: Self = Self {
        param1: 0.0_f32,
        param2: 0.0_f32,
        param3: 0.0_f32,
        param4: 0.0_f32,
        param5: 0.0_f32,
        param6: 0.0_f32,
        param7: 0.0_f32,
        command: MavCmd::DEFAULT,
        target_system: 0_u8,
        target_component: 0_u8,
        confirmation: 0_u8,
    };
}
impl Default for COMMAND_LONG_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for COMMAND_LONG_DATA {
    type Message = MavMessage;
    const ID: u32 = 76u32;
    const NAME: &'static str = "COMMAND_LONG";
    const EXTRA_CRC: u8 = 152u8;
    const ENCODED_LEN: usize = 33usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.param1 = buf.get_f32_le()?;
        __struct.param2 = buf.get_f32_le()?;
        __struct.param3 = buf.get_f32_le()?;
        __struct.param4 = buf.get_f32_le()?;
        __struct.param5 = buf.get_f32_le()?;
        __struct.param6 = buf.get_f32_le()?;
        __struct.param7 = buf.get_f32_le()?;
        let tmp = buf.get_u16_le()?;
        __struct.command = FromPrimitive::from_u16(tmp).ok_or(
            ::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavCmd",
                value: tmp as u64,
            },
        )?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        __struct.confirmation = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.param1);
        __tmp.put_f32_le(self.param2);
        __tmp.put_f32_le(self.param3);
        __tmp.put_f32_le(self.param4);
        __tmp.put_f32_le(self.param5);
        __tmp.put_f32_le(self.param6);
        __tmp.put_f32_le(self.param7);
        __tmp.put_u16_le(self.command as u16);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        __tmp.put_u8(self.confirmation);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 287"]
#[derive(Debug, Clone, PartialEq)]
pub struct GIMBAL_MANAGER_SET_PITCHYAW_DATA {
    pub flags: GimbalManagerFlags,
    pub pitch: f32,
    pub yaw: f32,
    pub pitch_rate: f32,
    pub yaw_rate: f32,
    pub target_system: u8,
    pub target_component: u8,
    pub gimbal_device_id: u8,
}
impl GIMBAL_MANAGER_SET_PITCHYAW_DATA {
    pub const ENCODED_LEN: usize = 23usize;
    pub const DEFAULT: Self = Self {
        flags: GimbalManagerFlags::DEFAULT,
        pitch: 0.0_f32,
        yaw: 0.0_f32,
        pitch_rate: 0.0_f32,
        yaw_rate: 0.0_f32,
        target_system: 0_u8,
        target_component: 0_u8,
        gimbal_device_id: 0_u8,
    };
}
impl Default for GIMBAL_MANAGER_SET_PITCHYAW_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for GIMBAL_MANAGER_SET_PITCHYAW_DATA {
    type Message = MavMessage;
    const ID: u32 = 287u32;
    const NAME: &'static str = "GIMBAL_MANAGER_SET_PITCHYAW";
    const EXTRA_CRC: u8 = 1u8;
    const ENCODED_LEN: usize = 23usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        let tmp = buf.get_u32_le()?;
        __struct.flags =
            GimbalManagerFlags::from_bits_retain(tmp as <GimbalManagerFlags as Flags>::Bits);
        __struct.pitch = buf.get_f32_le()?;
        __struct.yaw = buf.get_f32_le()?;
        __struct.pitch_rate = buf.get_f32_le()?;
        __struct.yaw_rate = buf.get_f32_le()?;
        __struct.target_system = buf.get_u8()?;
        __struct.target_component = buf.get_u8()?;
        __struct.gimbal_device_id = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.flags.bits() as u32);
        __tmp.put_f32_le(self.pitch);
        __tmp.put_f32_le(self.yaw);
        __tmp.put_f32_le(self.pitch_rate);
        __tmp.put_f32_le(self.yaw_rate);
        __tmp.put_u8(self.target_system);
        __tmp.put_u8(self.target_component);
        __tmp.put_u8(self.gimbal_device_id);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 281"]
#[derive(Debug, Clone, PartialEq)]
pub struct GIMBAL_MANAGER_STATUS_DATA {
    pub time_boot_ms: u32,
    pub flags: GimbalManagerFlags,
    pub gimbal_device_id: u8,
    pub primary_control_sysid: u8,
    pub primary_control_compid: u8,
    pub secondary_control_sysid: u8,
    pub secondary_control_compid: u8,
}
impl GIMBAL_MANAGER_STATUS_DATA {
    pub const ENCODED_LEN: usize = 13usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        flags: GimbalManagerFlags::DEFAULT,
        gimbal_device_id: 0_u8,
        primary_control_sysid: 0_u8,
        primary_control_compid: 0_u8,
        secondary_control_sysid: 0_u8,
        secondary_control_compid: 0_u8,
    };
}
impl Default for GIMBAL_MANAGER_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for GIMBAL_MANAGER_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 281u32;
    const NAME: &'static str = "GIMBAL_MANAGER_STATUS";
    const EXTRA_CRC: u8 = 48u8;
    const ENCODED_LEN: usize = 13usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        let tmp = buf.get_u32_le()?;
        __struct.flags =
            GimbalManagerFlags::from_bits_retain(tmp as <GimbalManagerFlags as Flags>::Bits);
        __struct.gimbal_device_id = buf.get_u8()?;
        __struct.primary_control_sysid = buf.get_u8()?;
        __struct.primary_control_compid = buf.get_u8()?;
        __struct.secondary_control_sysid = buf.get_u8()?;
        __struct.secondary_control_compid = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_u32_le(self.flags.bits() as u32);
        __tmp.put_u8(self.gimbal_device_id);
        __tmp.put_u8(self.primary_control_sysid);
        __tmp.put_u8(self.primary_control_compid);
        __tmp.put_u8(self.secondary_control_sysid);
        __tmp.put_u8(self.secondary_control_compid);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 0"]
#[derive(Debug, Clone, PartialEq)]
pub struct HEARTBEAT_DATA {
    pub custom_mode: u32,
    pub mavtype: MavType,
    pub autopilot: MavAutopilot,
    pub base_mode: MavModeFlag,
    pub system_status: MavState,
    pub mavlink_version: u8,
}
impl HEARTBEAT_DATA {
    pub const ENCODED_LEN: usize = 9usize;
    pub const DEFAULT: Self = Self {
        custom_mode: 0_u32,
        mavtype: MavType::DEFAULT,
        autopilot: MavAutopilot::DEFAULT,
        base_mode: MavModeFlag::DEFAULT,
        system_status: MavState::DEFAULT,
        mavlink_version: MINOR_MAVLINK_VERSION,
    };
}
impl Default for HEARTBEAT_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for HEARTBEAT_DATA {
    type Message = MavMessage;
    const ID: u32 = 0u32;
    const NAME: &'static str = "HEARTBEAT";
    const EXTRA_CRC: u8 = 50u8;
    const ENCODED_LEN: usize = 9usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.custom_mode = buf.get_u32_le()?;
        let tmp = buf.get_u8()?;
        __struct.mavtype =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavType",
                value: tmp as u64,
            })?;
        let tmp = buf.get_u8()?;
        __struct.autopilot =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavAutopilot",
                value: tmp as u64,
            })?;
        let tmp = buf.get_u8()?;
        __struct.base_mode = MavModeFlag::from_bits_retain(tmp as <MavModeFlag as Flags>::Bits);
        let tmp = buf.get_u8()?;
        __struct.system_status =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavState",
                value: tmp as u64,
            })?;
        __struct.mavlink_version = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.custom_mode);
        __tmp.put_u8(self.mavtype as u8);
        __tmp.put_u8(self.autopilot as u8);
        __tmp.put_u8(self.base_mode.bits() as u8);
        __tmp.put_u8(self.system_status as u8);
        __tmp.put_u8(self.mavlink_version);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 149"]
#[derive(Debug, Clone, PartialEq)]
pub struct LANDING_TARGET_DATA {
    pub time_usec: u64,
    pub angle_x: f32,
    pub angle_y: f32,
    pub distance: f32,
    pub size_x: f32,
    pub size_y: f32,
    pub target_num: u8,
    pub frame: MavFrame,
}
impl LANDING_TARGET_DATA {
    pub const ENCODED_LEN: usize = 30usize;
    pub const DEFAULT: Self = Self {
        time_usec: 0_u64,
        angle_x: 0.0_f32,
        angle_y: 0.0_f32,
        distance: 0.0_f32,
        size_x: 0.0_f32,
        size_y: 0.0_f32,
        target_num: 0_u8,
        frame: MavFrame::DEFAULT,
    };
}
impl Default for LANDING_TARGET_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for LANDING_TARGET_DATA {
    type Message = MavMessage;
    const ID: u32 = 149u32;
    const NAME: &'static str = "LANDING_TARGET";
    const EXTRA_CRC: u8 = 200u8;
    const ENCODED_LEN: usize = 30usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_usec = buf.get_u64_le()?;
        __struct.angle_x = buf.get_f32_le()?;
        __struct.angle_y = buf.get_f32_le()?;
        __struct.distance = buf.get_f32_le()?;
        __struct.size_x = buf.get_f32_le()?;
        __struct.size_y = buf.get_f32_le()?;
        __struct.target_num = buf.get_u8()?;
        let tmp = buf.get_u8()?;
        __struct.frame =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "MavFrame",
                value: tmp as u64,
            })?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u64_le(self.time_usec);
        __tmp.put_f32_le(self.angle_x);
        __tmp.put_f32_le(self.angle_y);
        __tmp.put_f32_le(self.distance);
        __tmp.put_f32_le(self.size_x);
        __tmp.put_f32_le(self.size_y);
        __tmp.put_u8(self.target_num);
        __tmp.put_u8(self.frame as u8);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 261"]
#[derive(Debug, Clone, PartialEq)]
pub struct STORAGE_INFORMATION_DATA {
    pub time_boot_ms: u32,
    pub total_capacity: f32,
    pub used_capacity: f32,
    pub available_capacity: f32,
    pub read_speed: f32,
    pub write_speed: f32,
    pub storage_id: u8,
    pub storage_count: u8,
    pub status: StorageStatus,
}
impl STORAGE_INFORMATION_DATA {
    pub const ENCODED_LEN: usize = 27usize;
    pub const DEFAULT: Self = Self {
        time_boot_ms: 0_u32,
        total_capacity: 0.0_f32,
        used_capacity: 0.0_f32,
        available_capacity: 0.0_f32,
        read_speed: 0.0_f32,
        write_speed: 0.0_f32,
        storage_id: 0_u8,
        storage_count: 0_u8,
        status: StorageStatus::DEFAULT,
    };
}
impl Default for STORAGE_INFORMATION_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for STORAGE_INFORMATION_DATA {
    type Message = MavMessage;
    const ID: u32 = 261u32;
    const NAME: &'static str = "STORAGE_INFORMATION";
    const EXTRA_CRC: u8 = 179u8;
    const ENCODED_LEN: usize = 27usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.time_boot_ms = buf.get_u32_le()?;
        __struct.total_capacity = buf.get_f32_le()?;
        __struct.used_capacity = buf.get_f32_le()?;
        __struct.available_capacity = buf.get_f32_le()?;
        __struct.read_speed = buf.get_f32_le()?;
        __struct.write_speed = buf.get_f32_le()?;
        __struct.storage_id = buf.get_u8()?;
        __struct.storage_count = buf.get_u8()?;
        let tmp = buf.get_u8()?;
        __struct.status =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "StorageStatus",
                value: tmp as u64,
            })?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_u32_le(self.time_boot_ms);
        __tmp.put_f32_le(self.total_capacity);
        __tmp.put_f32_le(self.used_capacity);
        __tmp.put_f32_le(self.available_capacity);
        __tmp.put_f32_le(self.read_speed);
        __tmp.put_f32_le(self.write_speed);
        __tmp.put_u8(self.storage_id);
        __tmp.put_u8(self.storage_count);
        __tmp.put_u8(self.status as u8);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 269"]
#[derive(Debug, Clone, PartialEq)]
pub struct VIDEO_STREAM_INFORMATION_DATA {
    pub framerate: f32,
    pub bitrate: u32,
    pub flags: VideoStreamStatusFlags,
    pub resolution_h: u16,
    pub resolution_v: u16,
    pub rotation: u16,
    pub hfov: u16,
    pub stream_id: u8,
    pub count: u8,
    pub mavtype: VideoStreamType,
    pub name: CharArray<32>,
    pub uri: CharArray<160>,
}
impl VIDEO_STREAM_INFORMATION_DATA {
    pub const ENCODED_LEN: usize = 213usize;
    pub const DEFAULT: Self = Self {
        framerate: 0.0_f32,
        bitrate: 0_u32,
        flags: VideoStreamStatusFlags::DEFAULT,
        resolution_h: 0_u16,
        resolution_v: 0_u16,
        rotation: 0_u16,
        hfov: 0_u16,
        stream_id: 0_u8,
        count: 0_u8,
        mavtype: VideoStreamType::DEFAULT,
        name: CharArray::new([0_u8; 32usize]),
        uri: CharArray::new([0_u8; 160usize]),
    };
}
impl Default for VIDEO_STREAM_INFORMATION_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for VIDEO_STREAM_INFORMATION_DATA {
    type Message = MavMessage;
    const ID: u32 = 269u32;
    const NAME: &'static str = "VIDEO_STREAM_INFORMATION";
    const EXTRA_CRC: u8 = 109u8;
    const ENCODED_LEN: usize = 213usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.framerate = buf.get_f32_le()?;
        __struct.bitrate = buf.get_u32_le()?;
        let tmp = buf.get_u16_le()?;
        __struct.flags = VideoStreamStatusFlags::from_bits_retain(
            tmp as <VideoStreamStatusFlags as Flags>::Bits,
        );
        __struct.resolution_h = buf.get_u16_le()?;
        __struct.resolution_v = buf.get_u16_le()?;
        __struct.rotation = buf.get_u16_le()?;
        __struct.hfov = buf.get_u16_le()?;
        __struct.stream_id = buf.get_u8()?;
        __struct.count = buf.get_u8()?;
        let tmp = buf.get_u8()?;
        __struct.mavtype =
            FromPrimitive::from_u8(tmp).ok_or(::mavlink_core::error::ParserError::InvalidEnum {
                enum_type: "VideoStreamType",
                value: tmp as u64,
            })?;
        let mut tmp = [0_u8; 32usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.name = CharArray::new(tmp);
        let mut tmp = [0_u8; 160usize];
        for v in &mut tmp {
            *v = buf.get_u8()?;
        }
        __struct.uri = CharArray::new(tmp);
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.framerate);
        __tmp.put_u32_le(self.bitrate);
        __tmp.put_u16_le(self.flags.bits() as u16);
        __tmp.put_u16_le(self.resolution_h);
        __tmp.put_u16_le(self.resolution_v);
        __tmp.put_u16_le(self.rotation);
        __tmp.put_u16_le(self.hfov);
        __tmp.put_u8(self.stream_id);
        __tmp.put_u8(self.count);
        __tmp.put_u8(self.mavtype as u8);
        for val in &self.name {
            __tmp.put_u8(*val);
        }
        for val in &self.uri {
            __tmp.put_u8(*val);
        }
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[doc = "ID: 270"]
#[derive(Debug, Clone, PartialEq)]
pub struct VIDEO_STREAM_STATUS_DATA {
    pub framerate: f32,
    pub bitrate: u32,
    pub flags: VideoStreamStatusFlags,
    pub resolution_h: u16,
    pub resolution_v: u16,
    pub rotation: u16,
    pub hfov: u16,
    pub stream_id: u8,
}
impl VIDEO_STREAM_STATUS_DATA {
    pub const ENCODED_LEN: usize = 19usize;
    pub const DEFAULT: Self = Self {
        framerate: 0.0_f32,
        bitrate: 0_u32,
        flags: VideoStreamStatusFlags::DEFAULT,
        resolution_h: 0_u16,
        resolution_v: 0_u16,
        rotation: 0_u16,
        hfov: 0_u16,
        stream_id: 0_u8,
    };
}
impl Default for VIDEO_STREAM_STATUS_DATA {
    fn default() -> Self {
        Self::DEFAULT.clone()
    }
}
impl MessageData for VIDEO_STREAM_STATUS_DATA {
    type Message = MavMessage;
    const ID: u32 = 270u32;
    const NAME: &'static str = "VIDEO_STREAM_STATUS";
    const EXTRA_CRC: u8 = 59u8;
    const ENCODED_LEN: usize = 19usize;
    fn deser(
        _version: MavlinkVersion,
        __input: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        let avail_len = __input.len();
        let mut payload_buf;
        let mut buf = if avail_len < Self::ENCODED_LEN {
            payload_buf = [0; Self::ENCODED_LEN];
            payload_buf[0..avail_len].copy_from_slice(__input);
            Bytes::new(&payload_buf)
        } else {
            Bytes::new(__input)
        };
        let mut __struct = Self::default();
        __struct.framerate = buf.get_f32_le()?;
        __struct.bitrate = buf.get_u32_le()?;
        let tmp = buf.get_u16_le()?;
        __struct.flags = VideoStreamStatusFlags::from_bits_retain(
            tmp as <VideoStreamStatusFlags as Flags>::Bits,
        );
        __struct.resolution_h = buf.get_u16_le()?;
        __struct.resolution_v = buf.get_u16_le()?;
        __struct.rotation = buf.get_u16_le()?;
        __struct.hfov = buf.get_u16_le()?;
        __struct.stream_id = buf.get_u8()?;
        Ok(__struct)
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        let mut __tmp = BytesMut::new(bytes);
        if __tmp.remaining() < Self::ENCODED_LEN {
            panic!(
                "buffer is too small (need {} bytes, but got {})",
                Self::ENCODED_LEN,
                __tmp.remaining(),
            )
        }
        __tmp.put_f32_le(self.framerate);
        __tmp.put_u32_le(self.bitrate);
        __tmp.put_u16_le(self.flags.bits() as u16);
        __tmp.put_u16_le(self.resolution_h);
        __tmp.put_u16_le(self.resolution_v);
        __tmp.put_u16_le(self.rotation);
        __tmp.put_u16_le(self.hfov);
        __tmp.put_u8(self.stream_id);
        if matches!(version, MavlinkVersion::V2) {
            let len = __tmp.len();
            ::mavlink_core::utils::remove_trailing_zeroes(&bytes[..len])
        } else {
            __tmp.len()
        }
    }
}
#[derive(Clone, PartialEq, Debug)]
#[repr(u32)]
pub enum MavMessage {
    #[doc = "ID: 262"]
    CAMERA_CAPTURE_STATUS(CAMERA_CAPTURE_STATUS_DATA),
    #[doc = "ID: 259"]
    CAMERA_INFORMATION(CAMERA_INFORMATION_DATA),
    #[doc = "ID: 260"]
    CAMERA_SETTINGS(CAMERA_SETTINGS_DATA),
    #[doc = "ID: 275"]
    CAMERA_TRACKING_IMAGE_STATUS(CAMERA_TRACKING_IMAGE_STATUS_DATA),
    #[doc = "ID: 77"]
    COMMAND_ACK(COMMAND_ACK_DATA),
    #[doc = "ID: 75"]
    COMMAND_INT(COMMAND_INT_DATA),
    #[doc = "ID: 76"]
    COMMAND_LONG(COMMAND_LONG_DATA),
    #[doc = "ID: 287"]
    GIMBAL_MANAGER_SET_PITCHYAW(GIMBAL_MANAGER_SET_PITCHYAW_DATA),
    #[doc = "ID: 281"]
    GIMBAL_MANAGER_STATUS(GIMBAL_MANAGER_STATUS_DATA),
    #[doc = "ID: 0"]
    HEARTBEAT(HEARTBEAT_DATA),
    #[doc = "ID: 149"]
    LANDING_TARGET(LANDING_TARGET_DATA),
    #[doc = "ID: 261"]
    STORAGE_INFORMATION(STORAGE_INFORMATION_DATA),
    #[doc = "ID: 269"]
    VIDEO_STREAM_INFORMATION(VIDEO_STREAM_INFORMATION_DATA),
    #[doc = "ID: 270"]
    VIDEO_STREAM_STATUS(VIDEO_STREAM_STATUS_DATA),
}
impl MavMessage {
    pub const fn all_ids() -> &'static [u32] {
        &[
            0u32, 75u32, 76u32, 77u32, 149u32, 259u32, 260u32, 261u32, 262u32, 269u32, 270u32,
            275u32, 281u32, 287u32,
        ]
    }
    pub const fn all_messages() -> &'static [(&'static str, u32)] {
        &[
            (HEARTBEAT_DATA::NAME, HEARTBEAT_DATA::ID),
            (COMMAND_INT_DATA::NAME, COMMAND_INT_DATA::ID),
            (COMMAND_LONG_DATA::NAME, COMMAND_LONG_DATA::ID),
            (COMMAND_ACK_DATA::NAME, COMMAND_ACK_DATA::ID),
            (LANDING_TARGET_DATA::NAME, LANDING_TARGET_DATA::ID),
            (CAMERA_INFORMATION_DATA::NAME, CAMERA_INFORMATION_DATA::ID),
            (CAMERA_SETTINGS_DATA::NAME, CAMERA_SETTINGS_DATA::ID),
            (STORAGE_INFORMATION_DATA::NAME, STORAGE_INFORMATION_DATA::ID),
            (
                CAMERA_CAPTURE_STATUS_DATA::NAME,
                CAMERA_CAPTURE_STATUS_DATA::ID,
            ),
            (
                VIDEO_STREAM_INFORMATION_DATA::NAME,
                VIDEO_STREAM_INFORMATION_DATA::ID,
            ),
            (VIDEO_STREAM_STATUS_DATA::NAME, VIDEO_STREAM_STATUS_DATA::ID),
            (
                CAMERA_TRACKING_IMAGE_STATUS_DATA::NAME,
                CAMERA_TRACKING_IMAGE_STATUS_DATA::ID,
            ),
            (
                GIMBAL_MANAGER_STATUS_DATA::NAME,
                GIMBAL_MANAGER_STATUS_DATA::ID,
            ),
            (
                GIMBAL_MANAGER_SET_PITCHYAW_DATA::NAME,
                GIMBAL_MANAGER_SET_PITCHYAW_DATA::ID,
            ),
        ]
    }
}
impl Message for MavMessage {
    fn parse(
        version: MavlinkVersion,
        id: u32,
        payload: &[u8],
    ) -> Result<Self, ::mavlink_core::error::ParserError> {
        match id {
            CAMERA_CAPTURE_STATUS_DATA::ID => {
                CAMERA_CAPTURE_STATUS_DATA::deser(version, payload).map(Self::CAMERA_CAPTURE_STATUS)
            }
            CAMERA_INFORMATION_DATA::ID => {
                CAMERA_INFORMATION_DATA::deser(version, payload).map(Self::CAMERA_INFORMATION)
            }
            CAMERA_SETTINGS_DATA::ID => {
                CAMERA_SETTINGS_DATA::deser(version, payload).map(Self::CAMERA_SETTINGS)
            }
            CAMERA_TRACKING_IMAGE_STATUS_DATA::ID => {
                CAMERA_TRACKING_IMAGE_STATUS_DATA::deser(version, payload)
                    .map(Self::CAMERA_TRACKING_IMAGE_STATUS)
            }
            COMMAND_ACK_DATA::ID => {
                COMMAND_ACK_DATA::deser(version, payload).map(Self::COMMAND_ACK)
            }
            COMMAND_INT_DATA::ID => {
                COMMAND_INT_DATA::deser(version, payload).map(Self::COMMAND_INT)
            }
            COMMAND_LONG_DATA::ID => {
                COMMAND_LONG_DATA::deser(version, payload).map(Self::COMMAND_LONG)
            }
            GIMBAL_MANAGER_SET_PITCHYAW_DATA::ID => {
                GIMBAL_MANAGER_SET_PITCHYAW_DATA::deser(version, payload)
                    .map(Self::GIMBAL_MANAGER_SET_PITCHYAW)
            }
            GIMBAL_MANAGER_STATUS_DATA::ID => {
                GIMBAL_MANAGER_STATUS_DATA::deser(version, payload).map(Self::GIMBAL_MANAGER_STATUS)
            }
            HEARTBEAT_DATA::ID => HEARTBEAT_DATA::deser(version, payload).map(Self::HEARTBEAT),
            LANDING_TARGET_DATA::ID => {
                LANDING_TARGET_DATA::deser(version, payload).map(Self::LANDING_TARGET)
            }
            STORAGE_INFORMATION_DATA::ID => {
                STORAGE_INFORMATION_DATA::deser(version, payload).map(Self::STORAGE_INFORMATION)
            }
            VIDEO_STREAM_INFORMATION_DATA::ID => {
                VIDEO_STREAM_INFORMATION_DATA::deser(version, payload)
                    .map(Self::VIDEO_STREAM_INFORMATION)
            }
            VIDEO_STREAM_STATUS_DATA::ID => {
                VIDEO_STREAM_STATUS_DATA::deser(version, payload).map(Self::VIDEO_STREAM_STATUS)
            }
            _ => Err(::mavlink_core::error::ParserError::UnknownMessage { id }),
        }
    }
    fn message_name(&self) -> &'static str {
        match self {
            Self::CAMERA_CAPTURE_STATUS(..) => CAMERA_CAPTURE_STATUS_DATA::NAME,
            Self::CAMERA_INFORMATION(..) => CAMERA_INFORMATION_DATA::NAME,
            Self::CAMERA_SETTINGS(..) => CAMERA_SETTINGS_DATA::NAME,
            Self::CAMERA_TRACKING_IMAGE_STATUS(..) => CAMERA_TRACKING_IMAGE_STATUS_DATA::NAME,
            Self::COMMAND_ACK(..) => COMMAND_ACK_DATA::NAME,
            Self::COMMAND_INT(..) => COMMAND_INT_DATA::NAME,
            Self::COMMAND_LONG(..) => COMMAND_LONG_DATA::NAME,
            Self::GIMBAL_MANAGER_SET_PITCHYAW(..) => GIMBAL_MANAGER_SET_PITCHYAW_DATA::NAME,
            Self::GIMBAL_MANAGER_STATUS(..) => GIMBAL_MANAGER_STATUS_DATA::NAME,
            Self::HEARTBEAT(..) => HEARTBEAT_DATA::NAME,
            Self::LANDING_TARGET(..) => LANDING_TARGET_DATA::NAME,
            Self::STORAGE_INFORMATION(..) => STORAGE_INFORMATION_DATA::NAME,
            Self::VIDEO_STREAM_INFORMATION(..) => VIDEO_STREAM_INFORMATION_DATA::NAME,
            Self::VIDEO_STREAM_STATUS(..) => VIDEO_STREAM_STATUS_DATA::NAME,
        }
    }
    fn message_id(&self) -> u32 {
        match self {
            Self::CAMERA_CAPTURE_STATUS(..) => CAMERA_CAPTURE_STATUS_DATA::ID,
            Self::CAMERA_INFORMATION(..) => CAMERA_INFORMATION_DATA::ID,
            Self::CAMERA_SETTINGS(..) => CAMERA_SETTINGS_DATA::ID,
            Self::CAMERA_TRACKING_IMAGE_STATUS(..) => CAMERA_TRACKING_IMAGE_STATUS_DATA::ID,
            Self::COMMAND_ACK(..) => COMMAND_ACK_DATA::ID,
            Self::COMMAND_INT(..) => COMMAND_INT_DATA::ID,
            Self::COMMAND_LONG(..) => COMMAND_LONG_DATA::ID,
            Self::GIMBAL_MANAGER_SET_PITCHYAW(..) => GIMBAL_MANAGER_SET_PITCHYAW_DATA::ID,
            Self::GIMBAL_MANAGER_STATUS(..) => GIMBAL_MANAGER_STATUS_DATA::ID,
            Self::HEARTBEAT(..) => HEARTBEAT_DATA::ID,
            Self::LANDING_TARGET(..) => LANDING_TARGET_DATA::ID,
            Self::STORAGE_INFORMATION(..) => STORAGE_INFORMATION_DATA::ID,
            Self::VIDEO_STREAM_INFORMATION(..) => VIDEO_STREAM_INFORMATION_DATA::ID,
            Self::VIDEO_STREAM_STATUS(..) => VIDEO_STREAM_STATUS_DATA::ID,
        }
    }
    fn message_id_from_name(name: &str) -> Option<u32> {
        match name {
            CAMERA_CAPTURE_STATUS_DATA::NAME => Some(CAMERA_CAPTURE_STATUS_DATA::ID),
            CAMERA_INFORMATION_DATA::NAME => Some(CAMERA_INFORMATION_DATA::ID),
            CAMERA_SETTINGS_DATA::NAME => Some(CAMERA_SETTINGS_DATA::ID),
            CAMERA_TRACKING_IMAGE_STATUS_DATA::NAME => Some(CAMERA_TRACKING_IMAGE_STATUS_DATA::ID),
            COMMAND_ACK_DATA::NAME => Some(COMMAND_ACK_DATA::ID),
            COMMAND_INT_DATA::NAME => Some(COMMAND_INT_DATA::ID),
            COMMAND_LONG_DATA::NAME => Some(COMMAND_LONG_DATA::ID),
            GIMBAL_MANAGER_SET_PITCHYAW_DATA::NAME => Some(GIMBAL_MANAGER_SET_PITCHYAW_DATA::ID),
            GIMBAL_MANAGER_STATUS_DATA::NAME => Some(GIMBAL_MANAGER_STATUS_DATA::ID),
            HEARTBEAT_DATA::NAME => Some(HEARTBEAT_DATA::ID),
            LANDING_TARGET_DATA::NAME => Some(LANDING_TARGET_DATA::ID),
            STORAGE_INFORMATION_DATA::NAME => Some(STORAGE_INFORMATION_DATA::ID),
            VIDEO_STREAM_INFORMATION_DATA::NAME => Some(VIDEO_STREAM_INFORMATION_DATA::ID),
            VIDEO_STREAM_STATUS_DATA::NAME => Some(VIDEO_STREAM_STATUS_DATA::ID),
            _ => None,
        }
    }
    fn default_message_from_id(id: u32) -> Option<Self> {
        match id {
            CAMERA_CAPTURE_STATUS_DATA::ID => Some(Self::CAMERA_CAPTURE_STATUS(
                CAMERA_CAPTURE_STATUS_DATA::default(),
            )),
            CAMERA_INFORMATION_DATA::ID => {
                Some(Self::CAMERA_INFORMATION(CAMERA_INFORMATION_DATA::default()))
            }
            CAMERA_SETTINGS_DATA::ID => {
                Some(Self::CAMERA_SETTINGS(CAMERA_SETTINGS_DATA::default()))
            }
            CAMERA_TRACKING_IMAGE_STATUS_DATA::ID => Some(Self::CAMERA_TRACKING_IMAGE_STATUS(
                CAMERA_TRACKING_IMAGE_STATUS_DATA::default(),
            )),
            COMMAND_ACK_DATA::ID => Some(Self::COMMAND_ACK(COMMAND_ACK_DATA::default())),
            COMMAND_INT_DATA::ID => Some(Self::COMMAND_INT(COMMAND_INT_DATA::default())),
            COMMAND_LONG_DATA::ID => Some(Self::COMMAND_LONG(COMMAND_LONG_DATA::default())),
            GIMBAL_MANAGER_SET_PITCHYAW_DATA::ID => Some(Self::GIMBAL_MANAGER_SET_PITCHYAW(
                GIMBAL_MANAGER_SET_PITCHYAW_DATA::default(),
            )),
            GIMBAL_MANAGER_STATUS_DATA::ID => Some(Self::GIMBAL_MANAGER_STATUS(
                GIMBAL_MANAGER_STATUS_DATA::default(),
            )),
            HEARTBEAT_DATA::ID => Some(Self::HEARTBEAT(HEARTBEAT_DATA::default())),
            LANDING_TARGET_DATA::ID => Some(Self::LANDING_TARGET(LANDING_TARGET_DATA::default())),
            STORAGE_INFORMATION_DATA::ID => Some(Self::STORAGE_INFORMATION(
                STORAGE_INFORMATION_DATA::default(),
            )),
            VIDEO_STREAM_INFORMATION_DATA::ID => Some(Self::VIDEO_STREAM_INFORMATION(
                VIDEO_STREAM_INFORMATION_DATA::default(),
            )),
            VIDEO_STREAM_STATUS_DATA::ID => Some(Self::VIDEO_STREAM_STATUS(
                VIDEO_STREAM_STATUS_DATA::default(),
            )),
            _ => None,
        }
    }
    fn ser(&self, version: MavlinkVersion, bytes: &mut [u8]) -> usize {
        match self {
            Self::CAMERA_CAPTURE_STATUS(body) => body.ser(version, bytes),
            Self::CAMERA_INFORMATION(body) => body.ser(version, bytes),
            Self::CAMERA_SETTINGS(body) => body.ser(version, bytes),
            Self::CAMERA_TRACKING_IMAGE_STATUS(body) => body.ser(version, bytes),
            Self::COMMAND_ACK(body) => body.ser(version, bytes),
            Self::COMMAND_INT(body) => body.ser(version, bytes),
            Self::COMMAND_LONG(body) => body.ser(version, bytes),
            Self::GIMBAL_MANAGER_SET_PITCHYAW(body) => body.ser(version, bytes),
            Self::GIMBAL_MANAGER_STATUS(body) => body.ser(version, bytes),
            Self::HEARTBEAT(body) => body.ser(version, bytes),
            Self::LANDING_TARGET(body) => body.ser(version, bytes),
            Self::STORAGE_INFORMATION(body) => body.ser(version, bytes),
            Self::VIDEO_STREAM_INFORMATION(body) => body.ser(version, bytes),
            Self::VIDEO_STREAM_STATUS(body) => body.ser(version, bytes),
        }
    }
    fn extra_crc(id: u32) -> u8 {
        SEEDS
            .binary_search_by_key(&id, |seed| seed.0)
            .map_or(0, |at| SEEDS[at].1)
    }
    fn target_system_id(&self) -> Option<u8> {
        match self {
            Self::COMMAND_INT(inner) => Some(inner.target_system),
            Self::COMMAND_LONG(inner) => Some(inner.target_system),
            Self::GIMBAL_MANAGER_SET_PITCHYAW(inner) => Some(inner.target_system),
            _ => None,
        }
    }
    fn target_system_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::COMMAND_INT(inner) => Some(&mut inner.target_system),
            Self::COMMAND_LONG(inner) => Some(&mut inner.target_system),
            Self::GIMBAL_MANAGER_SET_PITCHYAW(inner) => Some(&mut inner.target_system),
            _ => None,
        }
    }
    fn target_component_id(&self) -> Option<u8> {
        match self {
            Self::COMMAND_INT(inner) => Some(inner.target_component),
            Self::COMMAND_LONG(inner) => Some(inner.target_component),
            Self::GIMBAL_MANAGER_SET_PITCHYAW(inner) => Some(inner.target_component),
            _ => None,
        }
    }
    fn target_component_id_mut(&mut self) -> Option<&mut u8> {
        match self {
            Self::COMMAND_INT(inner) => Some(&mut inner.target_component),
            Self::COMMAND_LONG(inner) => Some(&mut inner.target_component),
            Self::GIMBAL_MANAGER_SET_PITCHYAW(inner) => Some(&mut inner.target_component),
            _ => None,
        }
    }
}
/// Number and checksum seed of every message of the dialect, by number.
const SEEDS: [(u32, u8); 234] = [
    (0, 50),
    (1, 124),
    (2, 137),
    (4, 237),
    (5, 217),
    (6, 104),
    (7, 119),
    (8, 117),
    (11, 89),
    (20, 214),
    (21, 159),
    (22, 220),
    (23, 168),
    (24, 24),
    (25, 23),
    (26, 170),
    (27, 144),
    (28, 67),
    (29, 115),
    (30, 39),
    (31, 246),
    (32, 185),
    (33, 104),
    (34, 237),
    (35, 244),
    (36, 222),
    (37, 212),
    (38, 9),
    (39, 254),
    (40, 230),
    (41, 28),
    (42, 28),
    (43, 132),
    (44, 221),
    (45, 232),
    (46, 11),
    (47, 153),
    (48, 41),
    (49, 39),
    (50, 78),
    (51, 196),
    (54, 15),
    (55, 3),
    (61, 167),
    (62, 183),
    (63, 119),
    (64, 191),
    (65, 118),
    (66, 148),
    (67, 21),
    (69, 243),
    (70, 124),
    (73, 38),
    (74, 20),
    (75, 158),
    (76, 152),
    (77, 143),
    (80, 14),
    (81, 106),
    (82, 49),
    (83, 22),
    (84, 143),
    (85, 140),
    (86, 5),
    (87, 150),
    (89, 231),
    (90, 183),
    (91, 63),
    (92, 54),
    (93, 47),
    (100, 175),
    (101, 102),
    (102, 158),
    (103, 208),
    (104, 56),
    (105, 93),
    (106, 138),
    (107, 108),
    (108, 32),
    (109, 185),
    (110, 84),
    (111, 34),
    (112, 174),
    (113, 124),
    (114, 237),
    (115, 4),
    (116, 76),
    (117, 128),
    (118, 56),
    (119, 116),
    (120, 134),
    (121, 237),
    (122, 203),
    (123, 250),
    (124, 87),
    (125, 203),
    (126, 220),
    (127, 25),
    (128, 226),
    (129, 46),
    (130, 29),
    (131, 223),
    (132, 85),
    (133, 6),
    (134, 229),
    (135, 203),
    (136, 1),
    (137, 195),
    (138, 109),
    (139, 168),
    (140, 181),
    (141, 47),
    (142, 72),
    (143, 131),
    (144, 127),
    (146, 103),
    (147, 154),
    (148, 178),
    (149, 200),
    (162, 189),
    (192, 36),
    (225, 208),
    (230, 163),
    (231, 105),
    (232, 151),
    (233, 35),
    (234, 150),
    (235, 179),
    (241, 90),
    (242, 104),
    (243, 85),
    (244, 95),
    (245, 130),
    (246, 184),
    (247, 81),
    (248, 8),
    (249, 204),
    (250, 49),
    (251, 170),
    (252, 44),
    (253, 83),
    (254, 46),
    (256, 71),
    (257, 131),
    (258, 187),
    (259, 92),
    (260, 146),
    (261, 179),
    (262, 12),
    (263, 133),
    (264, 49),
    (265, 26),
    (266, 193),
    (267, 35),
    (268, 14),
    (269, 109),
    (270, 59),
    (271, 22),
    (275, 126),
    (276, 18),
    (277, 62),
    (280, 70),
    (281, 48),
    (282, 123),
    (283, 74),
    (284, 99),
    (285, 137),
    (286, 210),
    (287, 1),
    (288, 20),
    (290, 251),
    (291, 10),
    (295, 234),
    (296, 158),
    (299, 19),
    (300, 217),
    (301, 243),
    (310, 28),
    (311, 95),
    (320, 243),
    (321, 88),
    (322, 243),
    (323, 78),
    (324, 132),
    (330, 23),
    (331, 91),
    (332, 236),
    (333, 231),
    (334, 72),
    (335, 225),
    (336, 245),
    (339, 199),
    (340, 99),
    (345, 209),
    (350, 232),
    (360, 11),
    (361, 93),
    (370, 75),
    (371, 10),
    (372, 26),
    (373, 117),
    (375, 251),
    (376, 199),
    (380, 232),
    (385, 147),
    (386, 132),
    (387, 4),
    (388, 8),
    (390, 156),
    (395, 0),
    (396, 50),
    (397, 182),
    (400, 110),
    (401, 183),
    (410, 160),
    (411, 106),
    (412, 33),
    (413, 77),
    (435, 134),
    (436, 193),
    (437, 30),
    (440, 66),
    (9000, 113),
    (9005, 117),
    (12900, 114),
    (12901, 254),
    (12902, 140),
    (12903, 249),
    (12904, 77),
    (12905, 49),
    (12915, 94),
    (12918, 139),
    (12919, 7),
    (12920, 20),
];

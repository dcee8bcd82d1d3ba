"""Writes the sample calibrations of this folder and the projections that other programs compute with them.

    pip install opencv-contrib-python-headless==5.0.0.93 numpy==2.4.6 PyYAML==6.0.3
    python generate.py

Each `NAME.csv` holds x,y,z,u,v: points in the file's common frame, in metres, and their pixels; `NAME.cam2.csv` those of the camera cam2.
OpenCV's own FileStorage writes the opencv-* files and OpenCV projects. ROS and Kalibr write their files with PyYAML, as here. There is
no Python package of Basalt's; its files have the layout that its C++ writes. Double sphere and extended unified points are projected by
the equations of the papers, OCamCalib's rays come from the equations of its cam2world.
"""

import json
from pathlib import Path

import cv2
import numpy as np
import yaml

HERE = Path(__file__).parent
WIDTH, HEIGHT = 640, 480
K = np.array([[412.31, 0.0, 321.7], [0.0, 409.87, 236.9], [0.0, 0.0, 1.0]])
ZERO = np.zeros(3)

random = np.random.default_rng(20260101)


def points(max_angle_deg, count=200):
    """Points around the optical axis, up to an angle from it, half a metre to five metres away, to a tenth of a millimetre."""
    angle = np.radians(max_angle_deg) * np.sqrt(random.uniform(0, 1, count))
    turn = random.uniform(0, 2 * np.pi, count)
    distance = random.uniform(0.5, 5.0, count)
    direction = [np.sin(angle) * np.cos(turn), np.sin(angle) * np.sin(turn), np.cos(angle)]
    return np.round((np.array(direction) * distance).T, 4)


def write_csv(name, xyz, uv):
    rows = np.hstack([xyz, np.asarray(uv).reshape(-1, 2)])
    lines = [",".join(repr(float(v)) for v in row) for row in rows]
    (HERE / f"{name}.csv").write_text("x,y,z,u,v\n" + "\n".join(lines) + "\n")


def pinhole(xyz, k, d, rvec=ZERO, tvec=ZERO):
    return cv2.projectPoints(xyz.reshape(-1, 1, 3), rvec, tvec, k, d)[0]


def fisheye(xyz, k, d, rvec=ZERO, tvec=ZERO):
    return cv2.fisheye.projectPoints(xyz.reshape(-1, 1, 3), rvec, tvec, k, d)[0]


def omnidir(xyz, k, xi, d, rvec=ZERO, tvec=ZERO):
    return cv2.omnidir.projectPoints(xyz.reshape(-1, 1, 3), rvec, tvec, k, xi, d)[0]


def double_sphere(xyz, fx, fy, cx, cy, xi, alpha):
    x, y, z = xyz.T
    d1 = np.sqrt(x**2 + y**2 + z**2)
    d2 = np.sqrt(x**2 + y**2 + (xi * d1 + z) ** 2)
    n = alpha * d2 + (1 - alpha) * (xi * d1 + z)
    return np.array([fx * x / n + cx, fy * y / n + cy]).T


def extended_unified(xyz, fx, fy, cx, cy, alpha, beta):
    x, y, z = xyz.T
    n = alpha * np.sqrt(beta * (x**2 + y**2) + z**2) + (1 - alpha) * z
    return np.array([fx * x / n + cx, fy * y / n + cy]).T


def storage(name, **values):
    """A file by OpenCV's FileStorage: YAML, XML or JSON by its suffix."""
    file = cv2.FileStorage(str(HERE / name), cv2.FILE_STORAGE_WRITE)
    for key, value in values.items():
        file.write(key, value if isinstance(value, (int, float, str)) else np.atleast_2d(np.asarray(value, float)))
    file.release()


def write_opencv():
    size = {"image_width": WIDTH, "image_height": HEIGHT}
    wide = points(38)
    d4 = np.array([-0.283, 0.0718, 0.00041, -0.00063])
    d5 = np.array([-0.283, 0.0718, 0.00041, -0.00063, 0.0112])
    d8 = np.array([0.213, -0.0541, 0.0007, -0.0002, 0.0033, 0.512, -0.0311, 0.0104])
    d12 = np.append(d8, [0.0012, -0.0004, -0.0009, 0.0003])
    d14 = np.append(d12, [0.0, 0.0])
    storage("opencv-pinhole4.yml", **size, cameraMatrix=K, distCoeffs=d4)
    storage("opencv-pinhole5.yml", **size, camera_matrix=K, distortion_coefficients=d5)
    storage("opencv-pinhole8.xml", **size, Camera_Matrix=K, Distortion_Coefficients=d8)
    storage("opencv-pinhole12.yml", **size, K=K, D=d12)
    storage("opencv-pinhole14.json", **size, camera_matrix=K, distortion_coefficients=d14)
    for name, d in [("pinhole4", d4), ("pinhole5", d5), ("pinhole8", d8), ("pinhole12", d12), ("pinhole14", d14)]:
        write_csv(f"opencv-{name}", wide, pinhole(wide, K, d))

    rvec, tvec = np.array([0.31, -0.24, 1.1]), np.array([0.2, -0.1, 0.4])
    storage("opencv-pose.yml", **size, K=K, D=d5, rvec=rvec, tvec=tvec)
    in_view = np.round((wide - tvec) @ cv2.Rodrigues(rvec)[0], 4)
    write_csv("opencv-pose", in_view, pinhole(in_view, K, d5, rvec, tvec))

    k = np.array([[251.3, 0.0, 318.2], [0.0, 250.9, 241.6], [0.0, 0.0, 1.0]])
    d = np.array([-0.0123, 0.0451, -0.0435, 0.0084])
    storage("opencv-fisheye.yml", **size, fisheye_model=1, camera_matrix=k, distortion_coefficients=d.reshape(4, 1))
    storage("opencv-fisheye-bare.xml", **size, K=k, D=d)
    xyz = points(85)
    write_csv("opencv-fisheye", xyz, fisheye(xyz, k, d))
    write_csv("opencv-fisheye-bare", xyz, fisheye(xyz, k, d))

    k = np.array([[408.9, 0.75, 630.3], [0.0, 410.5, 431.9], [0.0, 0.0, 1.0]])
    d, xi = np.array([-0.31, 0.09, 0.0012, -0.0008]), 1.053
    storage("opencv-omnidir.yml", image_width=1280, image_height=960, camera_matrix=k, distortion_coefficients=d, xi=[[xi]])
    storage("opencv-omnidir.xml", image_width=1280, image_height=960, K=k, D=d, xi=xi)
    xyz = points(100)
    write_csv("opencv-omnidir", xyz, omnidir(xyz, k, xi, d))

    k2 = np.array([[398.2, 0.0, 311.4], [0.0, 399.5, 243.3], [0.0, 0.0, 1.0]])
    d2 = np.array([-0.251, 0.0611, -0.0003, 0.0004, 0.0098])
    om, t = np.array([0.012, 0.21, -0.034]), np.array([-0.12, 0.003, 0.021])
    storage("opencv-stereo.yml", image_size=[WIDTH, HEIGHT], M1=K, D1=d5, M2=k2, D2=d2, R=cv2.Rodrigues(om)[0], T=t.reshape(3, 1))
    near = points(20)
    write_csv("opencv-stereo", near, pinhole(near, K, d5))
    write_csv("opencv-stereo.cam2", near, pinhole(near, k2, d2, om, t))


def ros_matrix(rows, columns, values):
    return {"rows": rows, "cols": columns, "data": [float(v) for v in np.ravel(values)]}


def write_ros():
    def file(name, model, k, d):
        projection = np.hstack([k, np.zeros((3, 1))])
        document = {
            "image_width": WIDTH,
            "image_height": HEIGHT,
            "camera_name": name,
            "camera_matrix": ros_matrix(3, 3, k),
            "distortion_model": model,
            "distortion_coefficients": ros_matrix(1, len(d), d),
            "rectification_matrix": ros_matrix(3, 3, np.eye(3)),
            "projection_matrix": ros_matrix(3, 4, projection),
        }
        (HERE / f"ros-{model}.yaml").write_text(yaml.dump(document))

    d5 = np.array([0.134462, -0.311908, 0.002304, 0.003083, 0.0])
    d8 = np.array([0.213, -0.0541, 0.0007, -0.0002, 0.0033, 0.512, -0.0311, 0.0104])
    d4 = np.array([-0.0123, 0.0451, -0.0435, 0.0084])
    file("narrow_stereo/left", "plumb_bob", K, d5)
    file("camera_2", "rational_polynomial", K, d8)
    file("fisheye", "equidistant", K, d4)
    xyz = points(30)
    write_csv("ros-plumb_bob", xyz, pinhole(xyz, K, d5))
    write_csv("ros-rational_polynomial", xyz, pinhole(xyz, K, d8))
    xyz = points(85)
    write_csv("ros-equidistant", xyz, fisheye(xyz, K, d4))

    # A message, as `rostopic echo` prints it.
    message = {
        "header": {"seq": 7, "stamp": {"secs": 1, "nsecs": 2}, "frame_id": "left"},
        "height": HEIGHT,
        "width": WIDTH,
        "distortion_model": "plumb_bob",
        "D": d5.tolist(),
        "K": K.ravel().tolist(),
        "R": np.eye(3).ravel().tolist(),
        "P": np.hstack([K, np.zeros((3, 1))]).ravel().tolist(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }
    (HERE / "ros-message.yaml").write_text(yaml.dump(message))
    xyz = points(30)
    write_csv("ros-message", xyz, pinhole(xyz, K, d5))


def transform(rvec, tvec):
    matrix = np.eye(4)
    matrix[:3, :3] = cv2.Rodrigues(np.array(rvec))[0]
    matrix[:3, 3] = tvec
    return matrix


def write_kalibr():
    def camera(model, intrinsics, distortion_model, coefficients, **more):
        return {
            "cam_overlaps": [],
            "camera_model": model,
            "distortion_coeffs": list(coefficients),
            "distortion_model": distortion_model,
            "intrinsics": list(intrinsics),
            "resolution": [752, 480],
            "rostopic": "/image_raw",
        } | {key: value.tolist() for key, value in more.items()}

    # An IMU whose frame is the common one, a radtan camera and an equidistant one.
    cam0_imu = transform([0.1, -1.2, 0.4], [0.06, -0.01, 0.02])
    cam1_cam0 = transform([0.01, 0.02, -0.01], [-0.11, 0.001, 0.002])
    f0, d0 = [461.629, 460.152, 362.68, 246.049], [-0.27695497, 0.06712482, 0.00087538, 0.00011556]
    f1, d1 = [274.516, 275.335, 313.614, 251.556], [-0.0273963, 0.0951249, -0.1127951, 0.0512381]
    chain = {
        "cam0": camera("pinhole", f0, "radtan", d0, T_cam_imu=cam0_imu),
        "cam1": camera("pinhole", f1, "equidistant", d1, T_cam_imu=cam1_cam0 @ cam0_imu, T_cn_cnm1=cam1_cam0),
    }
    (HERE / "kalibr-imu.yaml").write_text(yaml.safe_dump(chain, default_flow_style=None))
    in_camera = points(25)
    to_imu = np.linalg.inv(cam0_imu)
    xyz = np.round(in_camera @ to_imu[:3, :3].T + to_imu[:3, 3], 4)

    def matrix(f):
        return np.array([[f[0], 0, f[2]], [0, f[1], f[3]], [0, 0, 1.0]])

    def parts(pose):
        return cv2.Rodrigues(pose[:3, :3])[0], pose[:3, 3]

    write_csv("kalibr-imu", xyz, pinhole(xyz, matrix(f0), np.array(d0), *parts(cam0_imu)))
    write_csv("kalibr-imu.cam1", xyz, fisheye(xyz, matrix(f1), np.array(d1), *parts(cam1_cam0 @ cam0_imu)))

    # The other models, chained without an IMU.
    xi, f, d = 0.80065662, [833.006, 830.345, 373.85, 253.749], [-0.3351875, 0.13211436, 0.00055967, 0.00057686]
    ds = [-0.1996, 0.5925, 317.55, 316.17, 374.86, 246.57]
    eucm = [0.5903, 1.1275, 460.76, 459.41, 365.89, 249.33]
    step = transform([0.0, 0.1, 0.0], [-0.1, 0.0, 0.01])
    chain = {
        "cam0": camera("omni", [xi, *f], "radtan", d),
        "cam1": camera("ds", ds, "none", [], T_cn_cnm1=step),
        "cam2": camera("eucm", eucm, "none", [], T_cn_cnm1=step),
        "cam3": camera("pinhole", f0, "none", [], T_cn_cnm1=step),
    }
    (HERE / "kalibr-chain.yaml").write_text(yaml.safe_dump(chain, default_flow_style=None))
    xyz = points(20)
    moved = [xyz]
    for _ in range(3):
        moved.append(moved[-1] @ step[:3, :3].T + step[:3, 3])
    write_csv("kalibr-chain", xyz, omnidir(xyz, matrix(f), xi, np.array(d)))
    write_csv("kalibr-chain.cam1", xyz, double_sphere(moved[1], *ds[2:], *ds[:2]))
    write_csv("kalibr-chain.cam2", xyz, extended_unified(moved[2], *eucm[2:], *eucm[:2]))
    write_csv("kalibr-chain.cam3", xyz, pinhole(moved[3], matrix(f0), np.zeros(4)))


def write_basalt():
    names = ["fx", "fy", "cx", "cy"]
    f = [158.286, 158.274, 254.961, 256.889]
    k4, k8 = [-0.0067, 0.0452, -0.0435, 0.0084], [0.213, -0.0541, 0.0007, -0.0002, 0.0033, 0.512, -0.0311, 0.0104]
    k = np.array([[f[0], 0, f[2]], [0, f[1], f[3]], [0, 0, 1.0]])
    models = [
        ("ds", {"xi": -0.1721, "alpha": 0.5931}, lambda p: double_sphere(p, *f, -0.1721, 0.5931)),
        ("kb4", dict(zip(["k1", "k2", "k3", "k4"], k4)), lambda p: fisheye(p, k, np.array(k4))),
        ("eucm", {"alpha": 0.59, "beta": 1.127}, lambda p: extended_unified(p, *f, 0.59, 1.127)),
        ("ucm", {"alpha": 0.61}, lambda p: extended_unified(p, *f, 0.61, 1.0)),
        ("pinhole", {}, lambda p: pinhole(p, k, np.zeros(4))),
        (
            "pinhole-radtan8",
            dict(zip(["k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6"], k8)) | {"rpmax": 0.0},
            lambda p: pinhole(p, k, np.array(k8)),
        ),
    ]
    xyz = points(20)
    transforms, intrinsics = [], []
    for i, (kind, more, project) in enumerate(models):
        imu_from_camera = transform([0.0, 0.02 * i, 0.3 * i], [0.03 * i, -0.07, 0.01])
        half = 0.5 * np.linalg.norm([0.0, 0.02 * i, 0.3 * i])
        axis = np.array([0.0, 0.02 * i, 0.3 * i]) / (2 * half if half else 1)
        qx, qy, qz = np.sin(half) * axis
        px, py, pz = imu_from_camera[:3, 3]
        pose = dict(px=px, py=py, pz=pz, qx=qx, qy=qy, qz=qz, qw=np.cos(half))
        transforms.append({key: float(value) for key, value in pose.items()})
        intrinsics.append({"camera_type": kind, "intrinsics": dict(zip(names, f)) | more})
        camera_from_imu = np.linalg.inv(imu_from_camera)
        in_camera = xyz @ camera_from_imu[:3, :3].T + camera_from_imu[:3, 3]
        write_csv("basalt" if i == 0 else f"basalt.cam{i}", xyz, project(in_camera))
    document = {
        "T_imu_cam": transforms,
        "intrinsics": intrinsics,
        "resolution": [[512, 512]] * len(models),
        "calib_accel_bias": [0.0] * 9,
        "calib_gyro_bias": [0.0] * 12,
        "imu_update_rate": 200.0,
        "accel_noise_std": [0.016] * 3,
        "gyro_noise_std": [0.000282] * 3,
        "cam_time_offset_ns": 0,
        "vignette": [{"value0": 0, "value1": 50000000000, "value2": [[1.0], [0.977], [0.0686]]}],
    }
    (HERE / "basalt.json").write_text(json.dumps({"value0": document}, indent=4) + "\n")


def write_ocamcalib():
    """Rays of pixels by cam2world, in our axes: (x, y, z) of the toolbox is (y, x, -z) here."""
    for name in ["ocamcalib-fisheye", "ocamcalib-catadioptric"]:
        lines = (HERE / f"{name}.txt").read_text().splitlines()
        lists = [[float(v) for v in line.split()] for line in lines if line.strip() and line[0] != "#"]
        polynomial, (row, column), (c, d, e), (height, width) = lists[0][1:], lists[2], lists[3], lists[4]
        uv = np.round(random.uniform([0, 0], [width - 1, height - 1], (300, 2)), 2)
        # Within the circle that the image shows.
        uv = uv[np.hypot(uv[:, 0] - column, uv[:, 1] - row) < height / 2]
        dx, dy = uv[:, 1] - row, uv[:, 0] - column
        x, y = (dx - d * dy) / (c - d * e), (-e * dx + c * dy) / (c - d * e)
        z = np.polyval(polynomial[::-1], np.hypot(x, y))
        write_csv(name, np.array([y, x, -z]).T / 100, uv)


def write_real():
    """Projections with the two calibrations that OpenCV itself distributes."""
    file = cv2.FileStorage(str(HERE / "opencv-left-intrinsics.yml"), cv2.FILE_STORAGE_READ)
    xyz = points(30)
    k, d = file.getNode("camera_matrix").mat(), file.getNode("distortion_coefficients").mat()
    write_csv("opencv-left-intrinsics", xyz, pinhole(xyz, k, d))
    file = cv2.FileStorage(str(HERE / "opencv-stereo-intrinsics.yml"), cv2.FILE_STORAGE_READ)
    for suffix, number in [("", "1"), (".cam2", "2")]:
        k, d = file.getNode(f"M{number}").mat(), file.getNode(f"D{number}").mat()
        write_csv(f"opencv-stereo-intrinsics{suffix}", xyz, pinhole(xyz, k, d))


write_opencv()
write_ros()
write_kalibr()
write_basalt()
write_ocamcalib()
write_real()

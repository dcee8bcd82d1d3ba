use std::fs;
use std::io::ErrorKind;

use pardalis_scene::{CameraConfig, Input, Scene, VideoPlace};

use super::*;
use crate::commands::devices::nodes::trouble;

const WEBCAM: &str = "\
[video4linux2,v4l2 @ 0x5581c0ffee00] Raw       :     yuyv422 :           YUYV 4:2:2 : 640x480 160x120 1920x1080
[video4linux2,v4l2 @ 0x5581c0ffee00] Compressed:        h264 :                H.264 : 640x480 1920x1080
[video4linux2,v4l2 @ 0x5581c0ffee00] Compressed:       mjpeg :          Motion-JPEG : 640x480 1280x720 1920x1080
/dev/video0: Immediate exit requested
";
const METADATA: &str =
    "[video4linux2,v4l2 @ 0x55] ioctl(VIDIOC_G_INPUT): Inappropriate ioctl for device
/dev/video1: Inappropriate ioctl for device
";
const INFRARED: &str = "\
[video4linux2,v4l2 @ 0x55] Raw       :        gray :     8-bit Greyscale : Emulated : {32-2592, 2}x{32-1944, 2}
[video4linux2,v4l2 @ 0x55] Raw       : Unsupported :   8-bit Bayer GRBG/GRBG : 640x480
/dev/video2: Immediate exit requested
";

/// Roots of `/dev` and `/sys` with these devices, each with its driver's name.
fn computer(devices: &[(&str, &str)]) -> tempfile::TempDir {
    let root = tempfile::tempdir().unwrap();
    fs::create_dir_all(root.path().join("dev/v4l/by-id")).unwrap();
    for (device, name) in devices {
        fs::write(root.path().join("dev").join(device), "").unwrap();
        let class = root.path().join("sys/class/video4linux").join(device);
        fs::create_dir_all(&class).unwrap();
        fs::write(class.join("name"), format!("{name}\n")).unwrap();
    }
    root
}

fn listed(root: &tempfile::TempDir, ffmpeg: &dyn Fn(&Path) -> &'static str) -> Result<String> {
    let path = root.path();
    let messages_about = |device: &Path| Ok(ffmpeg(device).to_owned());
    Ok(cameras(&path.join("dev"), &path.join("sys"), &messages_about)?.join("\n"))
}

fn messages(device: &Path) -> &'static str {
    match device.file_name().unwrap().to_str().unwrap() {
        "video0" | "video10" => WEBCAM,
        "video1" => METADATA,
        _ => INFRARED,
    }
}

#[test]
fn cameras_are_listed_with_tables_that_a_scene_accepts() {
    let root = computer(&[
        ("video10", "HD Pro Webcam C920: HD Pro Webcam"),
        ("video0", "HD Pro Webcam C920: HD Pro Webcam"),
        ("video1", "HD Pro Webcam C920: metadata"),
        ("video2", "红外"),
    ]);
    let dev = root.path().join("dev").display().to_string();
    #[cfg(unix)]
    std::os::unix::fs::symlink(
        "../../video0",
        root.path().join("dev/v4l/by-id/usb-C920-index0"),
    )
    .unwrap();
    let text = listed(&root, &messages).unwrap();
    let wanted = format!(
        "# {dev}/video0: HD Pro Webcam C920: HD Pro Webcam
#   yuyv422: 640x480 160x120 1920x1080
#   h264: 640x480 1920x1080
#   mjpeg: 640x480 1280x720 1920x1080
[cameras.hd-pro-webcam-c920]
video = \"{dev}/video0\"
fps = 30  # asked for; the camera may have another
size_px = [1280, 720]  # that of the calibration
input.codec = \"mjpeg\"
# calibration = \"camera.toml\"
"
    );
    assert!(text.starts_with(&wanted), "{text}");
    let link = format!("# video = \"{dev}/v4l/by-id/usb-C920-index0\"\n");
    assert_eq!(text.contains(&link), cfg!(unix), "{text}");
    for part in [
        "video1: HD Pro Webcam C920: metadata\n#   it delivers no images that ffmpeg can read: /dev/video1: Inappropriate ioctl for device\n",
        "video2: 红外\n#   gray: any size\n[cameras.camera]\n",
        "input.pixel_format = \"gray\"\n",
        "[cameras.hd-pro-webcam-c920-2]\n",
    ] {
        assert!(text.contains(part), "{part} in {text}");
    }
    // With what only the user knows, this is a scene. The devices of a test are not in /dev.
    let own = "model.pinhole = { f_px = [900, 900], center_px = [640, 360] }\n\
               world_from_camera = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, NUMBER], [0, 0, 0, 1]]";
    let mut scene = text.replace(&dev, "/dev");
    for number in 0..3 {
        let own = own.replace("NUMBER", &number.to_string());
        scene = scene.replacen("# calibration = \"camera.toml\"", &own, 1);
    }
    scene += "[targets.ball]\nshape.sphere.radius_m = 0.1\ncolors = \"ball.toml\"\n";
    let scene = Scene::parse(&scene, &|_, _| Err(String::new())).unwrap();
    let place = |camera: &CameraConfig| match &camera.input {
        Input::Video { video, .. } => video.place.clone(),
        _ => panic!("no video"),
    };
    let devices: Vec<_> = scene.cameras.iter().map(place).collect();
    let device = |path: &str| VideoPlace::Device(path.to_owned());
    assert_eq!(
        devices,
        [
            device("/dev/video0"),
            device("/dev/video2"),
            device("/dev/video10")
        ]
    );
}

#[test]
fn what_is_missing_is_said_with_its_remedy() {
    let none = listed(&computer(&[]), &messages).unwrap_err().to_string();
    assert!(
        none.starts_with("no camera was found: there is no "),
        "{none}"
    );
    assert!(none.contains("plug one in"), "{none}");
    let only_metadata = listed(&computer(&[("video1", "x")]), &messages).unwrap_err();
    assert!(
        only_metadata
            .to_string()
            .contains("video1 delivers no images")
    );
    // In a container, the kernel's list shows devices that it cannot open.
    let root = computer(&[("video0", "C920")]);
    fs::remove_file(root.path().join("dev/video0")).unwrap();
    let text = listed(&root, &messages).unwrap();
    assert!(
        text.contains("video0: C920\n#   the kernel knows it, and there is no such file"),
        "{text}"
    );
    let denied = trouble(ErrorKind::PermissionDenied, "");
    assert!(denied.contains("group video"), "{denied}");
    // Without ffmpeg, which would say what the camera delivers.
    let text = listed(&computer(&[("video0", "C920")]), &|_| "").unwrap();
    assert!(text.contains("\n[cameras.c920]\nvideo = \""), "{text}");
    assert!(!text.contains("input."), "{text}");
}

//! A movie of frames: PNG files in; `flight.mp4` out, or `flight.png`, an animated PNG, where ffmpeg cannot be had.
//!
//! Either is written to a temporary beside it and renamed when it is whole. O(pixels); one frame in memory at a time.

use crate::options::{ToolError, ToolResult, make_folder};
use image::{RgbImage, imageops};
use std::{
    io::{self, BufWriter, Read, Write},
    path::{Path, PathBuf},
    process::{Command, Stdio},
    thread,
};

/// Frames of an animated PNG are at most this wide: it has no prediction between frames.
const MOST_ANIMATED_WIDTH: u32 = 640;

/// Why ffmpeg made no movie.
enum NoMovie {
    /// There is no such program.
    Absent,
    /// It says why.
    Failed(String),
    /// Not its fault: a frame could not be read or the movie not be put in place.
    Tool(ToolError),
}

/// Writes `frames`, in their order, as a movie of `fps` (at least 1) frames a second to `out_folder`; answers its path.
///
/// # Errors
/// If there are no frames, one cannot be read or has another size, or the folder cannot be written. An ffmpeg that fails is
/// a warning on standard error, and the movie becomes an animated PNG.
pub fn write_movie(frames: &[PathBuf], fps: u32, out_folder: &Path) -> ToolResult<PathBuf> {
    write_movie_with("ffmpeg", frames, fps, out_folder)
}

fn write_movie_with(
    ffmpeg: &str,
    frames: &[PathBuf],
    fps: u32,
    out_folder: &Path,
) -> ToolResult<PathBuf> {
    if frames.is_empty() {
        return Err(ToolError::Message("a movie needs at least one frame".into()));
    }
    make_folder(out_folder)?;
    let fps = fps.max(1);
    match encode(ffmpeg, frames, fps, &out_folder.join("flight.mp4")) {
        Ok(path) => return Ok(path),
        Err(NoMovie::Tool(error)) => return Err(error),
        Err(NoMovie::Absent) => {}
        Err(NoMovie::Failed(why)) => {
            eprintln!(" WARN ffmpeg made no mp4, writing an animated PNG instead: {why}");
        }
    }
    animate(frames, fps, &out_folder.join("flight.png"))
}

/// An empty temporary beside `path`, with the ending of `path` and the rights of any new file.
fn temporary(path: &Path) -> ToolResult<tempfile::NamedTempFile> {
    let folder = path.parent().unwrap_or(Path::new("."));
    let ending = path.extension().map(|e| format!(".{}", e.to_string_lossy())).unwrap_or_default();
    let mut builder = tempfile::Builder::new();
    builder.prefix(".flight").suffix(&ending);
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder).map_err(|error| ToolError::write(path, error))
}

/// H.264 in 4:2:0, which every player has; that needs even sizes.
fn encode(program: &str, frames: &[PathBuf], fps: u32, path: &Path) -> Result<PathBuf, NoMovie> {
    let file = temporary(path).map_err(NoMovie::Tool)?.into_temp_path();
    let mut command = Command::new(program);
    command
        .args(["-y", "-loglevel", "error", "-f", "image2pipe", "-c:v", "png", "-framerate"])
        .arg(fps.to_string())
        .args(["-i", "-", "-vf", "crop=trunc(iw/2)*2:trunc(ih/2)*2", "-c:v", "libx264"])
        .args(["-pix_fmt", "yuv420p", "-crf", "18", "-movflags", "+faststart", "-f", "mp4"])
        .arg(&file)
        .stdin(Stdio::piped())
        .stdout(Stdio::null())
        .stderr(Stdio::piped());
    let mut child = command.spawn().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => NoMovie::Absent,
        _ => NoMovie::Failed(error.to_string()),
    })?;
    // Read beside the writing: a full pipe of complaints would stop ffmpeg, and so this.
    let mut complaints = child.stderr.take();
    let listener = thread::spawn(move || {
        let mut text = Vec::new();
        if let Some(pipe) = &mut complaints {
            let _ = pipe.read_to_end(&mut text);
        }
        String::from_utf8_lossy(&text).trim().to_owned()
    });
    let mut unreadable = None;
    if let Some(mut pipe) = child.stdin.take() {
        for frame in frames {
            match std::fs::read(frame) {
                // A closed pipe means that ffmpeg ended; it has said why.
                Ok(bytes) if pipe.write_all(&bytes).is_err() => break,
                Ok(_) => {}
                Err(error) => {
                    unreadable = Some(cannot_read(frame, error));
                    break;
                }
            }
        }
    }
    let status = child.wait().map_err(|error| NoMovie::Failed(error.to_string()))?;
    let said = listener.join().unwrap_or_default();
    if let Some(error) = unreadable {
        return Err(NoMovie::Tool(error));
    }
    let written = std::fs::metadata(&file).map(|m| m.len()).unwrap_or(0);
    if !status.success() || written == 0 {
        let why = if said.is_empty() { format!("it ended with {status}") } else { said };
        return Err(NoMovie::Failed(why));
    }
    file.persist(path).map_err(|e| NoMovie::Tool(ToolError::write(path, e.error)))?;
    Ok(path.to_owned())
}

fn cannot_read(frame: &Path, error: impl ToString) -> ToolError {
    ToolError::Message(format!("cannot read frame {}: {}", frame.display(), error.to_string()))
}

/// A frame, scaled down to at most [`MOST_ANIMATED_WIDTH`].
fn small_frame(path: &Path) -> ToolResult<RgbImage> {
    let image = image::open(path).map_err(|error| cannot_read(path, error))?.into_rgb8();
    let (width, height) = image.dimensions();
    if width <= MOST_ANIMATED_WIDTH {
        return Ok(image);
    }
    let scaled = (u64::from(height) * u64::from(MOST_ANIMATED_WIDTH) / u64::from(width)).max(1);
    let filter = imageops::FilterType::Triangle;
    Ok(imageops::resize(&image, MOST_ANIMATED_WIDTH, scaled as u32, filter))
}

/// Plays for ever.
fn animate(frames: &[PathBuf], fps: u32, path: &Path) -> ToolResult<PathBuf> {
    let first = small_frame(&frames[0])?;
    let (width, height) = first.dimensions();
    let mut file = temporary(path)?;
    let cannot_write = |error: png::EncodingError| ToolError::write(path, error);
    let mut encoder = png::Encoder::new(BufWriter::new(file.as_file_mut()), width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_animated(frames.len() as u32, 0).map_err(cannot_write)?;
    encoder.set_frame_delay(1, fps.min(u32::from(u16::MAX)) as u16).map_err(cannot_write)?;
    let mut writer = encoder.write_header().map_err(cannot_write)?;
    for (i, frame) in frames.iter().enumerate() {
        let image = if i == 0 { first.clone() } else { small_frame(frame)? };
        if image.dimensions() != (width, height) {
            return Err(cannot_read(
                frame,
                format!("its size is not that of {}", frames[0].display()),
            ));
        }
        writer.write_image_data(&image).map_err(cannot_write)?;
    }
    writer.finish().map_err(cannot_write)?;
    file.persist(path).map_err(|e| ToolError::write(path, e.error))?;
    Ok(path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;
    use std::fs::File;

    /// `count` frames, each of another grey.
    fn frames(folder: &Path, count: u32, width: u32, height: u32) -> Vec<PathBuf> {
        let make = |i: u32| {
            let path = folder.join(format!("frame's {i:04}.png"));
            RgbImage::from_pixel(width, height, Rgb([i as u8 * 20; 3])).save(&path).expect("saves");
            path
        };
        (0..count).map(make).collect()
    }

    fn files(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .expect("is there")
            .map(|e| e.expect("readable").file_name().to_string_lossy().into_owned())
            .filter(|name| !name.starts_with("frame"))
            .collect();
        names.sort();
        names
    }

    fn check_animation(path: &Path, count: u32, size: (u32, u32)) {
        let file = io::BufReader::new(File::open(path).expect("opens"));
        let mut reader = png::Decoder::new(file).read_info().expect("is a PNG");
        assert_eq!((reader.info().width, reader.info().height), size);
        let control = reader.info().animation_control.expect("is animated");
        assert_eq!((control.num_frames, control.num_plays), (count, 0));
        let mut pixels = vec![0; reader.output_buffer_size().expect("fits")];
        for i in 0..count {
            reader.next_frame(&mut pixels).expect("a frame");
            assert_eq!(pixels[0], i as u8 * 20, "frame {i}");
            let delay = reader.info().frame_control.expect("has a delay");
            assert_eq!((delay.delay_num, delay.delay_den), (1, 12));
        }
    }

    #[test]
    fn without_ffmpeg_the_movie_is_an_animated_png() {
        let folder = tempfile::tempdir().expect("a folder");
        let frames = frames(folder.path(), 4, 90, 51);
        let path = write_movie_with("no such program", &frames, 12, folder.path()).expect("works");
        check_animation(&path, 4, (90, 51));
        assert_eq!(files(folder.path()), ["flight.png"]);
    }

    #[test]
    fn wide_frames_are_scaled_down_in_an_animated_png() {
        let folder = tempfile::tempdir().expect("a folder");
        let frames = frames(folder.path(), 2, 1280, 720);
        let path = write_movie_with("no such program", &frames, 12, folder.path()).expect("works");
        check_animation(&path, 2, (640, 360));
    }

    #[cfg(unix)]
    #[test]
    fn an_ffmpeg_that_fails_leaves_nothing_behind_but_the_animated_png() {
        let folder = tempfile::tempdir().expect("a folder");
        let frames = frames(folder.path(), 3, 64, 32);
        // The first fails, the second claims success and writes nothing.
        for program in ["false", "true"] {
            let path = write_movie_with(program, &frames, 12, folder.path()).expect("works");
            check_animation(&path, 3, (64, 32));
            assert_eq!(files(folder.path()), ["flight.png"]);
        }
    }

    #[test]
    fn ffmpeg_makes_an_mp4_of_even_size() {
        if Command::new("ffmpeg").arg("-version").output().is_err() {
            println!("SKIPPED ffmpeg_makes_an_mp4_of_even_size: no ffmpeg");
            return;
        }
        let folder = tempfile::tempdir().expect("a folder");
        let frames = frames(folder.path(), 6, 97, 55);
        let path = write_movie(&frames, 12, folder.path()).expect("works");
        let ending = path.extension().map(|e| e.to_string_lossy().into_owned());
        if ending.as_deref() == Some("png") {
            println!("SKIPPED ffmpeg_makes_an_mp4_of_even_size: this ffmpeg has no libx264");
            return;
        }
        assert_eq!(files(folder.path()), ["flight.mp4"]);
        assert_eq!(&std::fs::read(&path).expect("is there")[4..8], b"ftyp");
        let asked = ["-v", "error", "-count_frames", "-select_streams", "v:0", "-of", "csv=p=0"];
        let entries = ["-show_entries", "stream=width,height,pix_fmt,nb_read_frames"];
        if let Ok(said) = Command::new("ffprobe").args(asked).args(entries).arg(&path).output() {
            assert_eq!(String::from_utf8_lossy(&said.stdout).trim(), "96,54,yuv420p,6");
        }
    }

    #[test]
    fn bad_frames_are_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let mut list = frames(folder.path(), 2, 20, 20);
        assert!(write_movie(&[], 12, folder.path()).is_err());
        let other = folder.path().join("frame other.png");
        RgbImage::new(30, 20).save(&other).expect("saves");
        list.push(other);
        let size = write_movie_with("no such program", &list, 12, folder.path());
        assert!(size.expect_err("another size").to_string().contains("frame other.png"));
        list[1] = folder.path().join("frame missing.png");
        for program in ["no such program", "ffmpeg"] {
            let missing = write_movie_with(program, &list[..2], 12, folder.path());
            assert!(missing.expect_err("is missing").to_string().contains("frame missing.png"));
        }
        assert_eq!(files(folder.path()), Vec::<String>::new());
    }
}

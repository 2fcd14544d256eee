//! Frames of videos, by ffmpeg.

use crate::{
    error::{Error, Result},
    frames::{Candidate, HEIGHT, Thumbnail, WIDTH},
    process::{CommandLine, Monitor, has_ffmpeg},
};
use std::{
    fs,
    io::{BufReader, Read},
    path::{Path, PathBuf},
    process::Stdio,
};

/// Candidates per second of a video.
const RATE: f64 = 12.0;

/// Filter that gives selected frames consecutive times, so that none is repeated or dropped.
const CONSECUTIVE: &str = "setpts=N/30/TB";

/// Facts of a video.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Facts {
    /// Frames per second.
    pub(crate) rate: f64,
    /// Length in seconds; 0 if unknown.
    pub(crate) seconds: f64,
    pub(crate) is_hdr: bool,
}

impl Facts {
    /// Reads the header of a video.
    ///
    /// # Errors
    ///
    /// ffmpeg is missing, or the file is no video.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        let entries = "stream=avg_frame_rate,color_transfer:format=duration";
        let words = ["-v", "error", "-select_streams", "v:0", "-show_entries", entries, "-of", "json"];
        let said = CommandLine::new("ffprobe", &words).with(&[&path.to_string_lossy()]).output();
        match said.and_then(|text| Self::parsed(&text)) {
            Some(facts) => Ok(facts),
            None if has_ffmpeg() => Err(Error::Input(format!(
                "{path:?} has no readable video; copy it again, or convert it: ffmpeg -i {} -c:v libx264 walk.mp4",
                path.display()
            ))),
            None => Err(Error::Input(
                "frames of videos are read by ffmpeg, which is not installed: apt install ffmpeg, or brew install ffmpeg, \
                 or a folder of pictures"
                    .into(),
            )),
        }
    }

    fn parsed(text: &str) -> Option<Self> {
        let facts: serde_json::Value = serde_json::from_str(text).ok()?;
        let stream = facts["streams"].get(0)?;
        let (count, unit) = stream["avg_frame_rate"].as_str()?.split_once('/')?;
        let rate = count.parse::<f64>().ok()? / unit.parse::<f64>().ok()?;
        let seconds = facts["format"]["duration"].as_str().and_then(|text| text.parse().ok()).unwrap_or(0.0);
        let is_hdr = matches!(stream["color_transfer"].as_str(), Some("smpte2084" | "arib-std-b67"));
        (rate.is_finite() && rate > 0.0).then_some(Self { rate, seconds, is_hdr })
    }

    /// Frames between two candidates.
    pub(crate) fn step(&self) -> u64 {
        ((self.rate / RATE).round() as u64).max(1)
    }
}

/// Measures about twelve frames of each second.
///
/// # Errors
///
/// ffmpeg decodes no frame, or an interruption.
pub(crate) fn candidates(path: &Path, facts: &Facts, monitor: &dyn Monitor) -> Result<Vec<Candidate>> {
    let step = facts.step();
    let filter = format!("select='not(mod(n,{step}))',{CONSECUTIVE},scale={WIDTH}:{HEIGHT},format=gray");
    let line = CommandLine::new("ffmpeg", &["-v", "error", "-i", &path.to_string_lossy()]);
    let line = line.with(&["-vf", &filter, "-r", "30", "-f", "rawvideo", "-"]);
    let unreadable = |said: &str| {
        Error::Input(format!(
            "{path:?} has no readable frame ({}); copy it again, or convert it on the phone or with another program",
            said.lines().next().unwrap_or("ffmpeg failed")
        ))
    };
    let child = line.command().stdout(Stdio::piped()).stderr(Stdio::piped()).spawn();
    let mut child = child.map_err(|error| unreadable(&error.to_string()))?;
    let errors = child.stderr.take().map(|mut stream| {
        std::thread::spawn(move || {
            let mut said = Vec::new();
            stream.read_to_end(&mut said).map(|_| String::from_utf8_lossy(&said).into_owned()).unwrap_or_default()
        })
    });
    let mut frames = BufReader::new(child.stdout.take().expect("it is piped"));
    let mut found: Vec<Candidate> = Vec::new();
    let mut before: Option<Thumbnail> = None;
    loop {
        let mut grey = vec![0; WIDTH * HEIGHT];
        if frames.read_exact(&mut grey).is_err() {
            break;
        }
        let thumbnail = Thumbnail { grey };
        found.push(Candidate::of(found.len() as u64 * step, &thumbnail, before.as_ref()));
        before = Some(thumbnail);
        monitor.done(found.len() as u64);
        if monitor.is_interrupted() {
            // It may have ended meanwhile.
            let _ = child.kill();
            return Err(Error::Interrupted);
        }
    }
    let _ = child.wait();
    let said = errors.and_then(|thread| thread.join().ok()).unwrap_or_default();
    if found.is_empty() {
        return Err(unreadable(&said));
    }
    if !said.trim().is_empty() {
        tracing::warn!(
            "{path:?} is damaged: {}; {} frames are readable",
            said.lines().next().unwrap_or(""),
            found.len()
        );
    }
    Ok(found)
}

/// Name of a frame's picture.
pub(crate) fn name_of(frame: u64) -> String {
    format!("{frame:06}.jpg")
}

/// Command line that writes frames as numbered JPEGs.
pub(crate) fn extraction(path: &Path, frames: &[u64], to: &Path) -> CommandLine {
    let terms: Vec<String> = frames.iter().map(|frame| format!("eq(n,{frame})")).collect();
    let filter = format!("select='{}',{CONSECUTIVE}", terms.join("+"));
    let line = CommandLine::new("ffmpeg", &["-v", "error", "-y", "-i", &path.to_string_lossy()]);
    let line = line.with(&["-vf", &filter, "-r", "30", "-q:v", "2"]);
    line.with(&[&to.join("%06d.jpg").to_string_lossy()])
}

/// Writes the frames that are missing, each under its number in the video.
///
/// # Errors
///
/// ffmpeg fails, or a full disk.
pub(crate) fn extract(
    path: &Path,
    frames: &[u64],
    to: &Path,
    log: &Path,
    monitor: &dyn Monitor,
) -> Result<CommandLine> {
    let missing: Vec<u64> = frames.iter().copied().filter(|frame| !to.join(name_of(*frame)).is_file()).collect();
    if missing.is_empty() {
        return Ok(extraction(path, frames, to));
    }
    let beside = log.parent().unwrap_or(to);
    let own = tempfile::tempdir_in(beside).map_err(Error::writing(beside))?;
    let line = extraction(path, &missing, own.path());
    line.run(log, monitor, |_| ())?;
    for (index, frame) in missing.iter().enumerate() {
        let written: PathBuf = own.path().join(name_of(index as u64 + 1));
        if written.is_file() {
            let place = to.join(name_of(*frame));
            fs::rename(&written, &place).map_err(Error::writing(&place))?;
        }
    }
    Ok(line)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_header_of_a_video_is_read() {
        let text = r#"{"streams": [{"avg_frame_rate": "30000/1001", "color_transfer": "arib-std-b67"}],
            "format": {"duration": "12.5"}}"#;
        let facts = Facts::parsed(text).unwrap();
        assert!((facts.rate - 29.97).abs() < 0.01 && facts.seconds == 12.5 && facts.is_hdr, "{facts:?}");
        assert_eq!(facts.step(), 2);
        assert_eq!(Facts::parsed(r#"{"streams": []}"#), None);
        assert_eq!(Facts { rate: 8.0, ..facts }.step(), 1);
    }

    #[test]
    fn frames_are_selected_by_number() {
        let line = extraction(Path::new("walk.mov"), &[4, 90], Path::new("images"));
        assert!(line.text().contains("eq(n,4)+eq(n,90)"), "{}", line.text());
    }
}

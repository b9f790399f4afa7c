//! Recordings as WAV files, with integer or float samples of any width.

use std::path::Path;

use symphonia::core::audio::Channels;
use symphonia::core::codecs::audio::{AudioDecoder, AudioDecoderOptions};
use symphonia::core::errors::Error as WavError;
use symphonia::core::formats::{FormatOptions, FormatReader, TrackType};
use symphonia::core::io::{MediaSourceStream, MediaSourceStreamOptions, ReadOnlySource};
use symphonia::default::codecs::PcmDecoder;
use symphonia::default::formats::WavReader;

use super::defects::{Timing, Truncation};
use super::rate::length_fault;
use super::riff;
use super::source::{Cut, MAX_CHANNELS, Source};
use crate::support::error::{Error, Result};

/// Reads the part of a WAV file within `cut`. Every sample is exact: float samples as they are, integer ones divided by
/// their full scale.
pub(super) fn read(path: &Path, cut: &Cut) -> Result<Source> {
    let unusable =
        |failure: &WavError| Error::file(path, format!("is not a readable WAV file: {failure}"));
    let samples = riff::open(path)?;
    let file_bytes = samples.get_ref().1.get_ref().metadata();
    let file_bytes = file_bytes.map_err(Error::io("open", path))?.len();
    let samples = Box::new(ReadOnlySource::new(samples));
    let stream = MediaSourceStream::new(samples, MediaSourceStreamOptions::default());
    let mut format =
        WavReader::try_new(stream, FormatOptions::default()).map_err(|e| unusable(&e))?;
    let track = format.default_track(TrackType::Audio);
    let Some((track, parameters)) = track.and_then(|track| {
        let parameters = track.codec_params.as_ref()?.audio()?;
        Some((track, parameters))
    }) else {
        return Err(Error::file(path, "holds no samples"));
    };
    let declared_frames = track.num_frames;
    let channel_count = parameters.channels.as_ref().map_or(1, Channels::count);
    let frame_bits = u64::from(parameters.bits_per_sample.unwrap_or(8)) * channel_count as u64;
    let Some(rate_hz) = parameters.sample_rate.filter(|&rate| rate > 0) else {
        return Err(Error::file(
            path,
            "has no sample rate in its header: convert it again",
        ));
    };
    let mut decoder = PcmDecoder::try_new(parameters, &AudioDecoderOptions::default())
        .map_err(|e| unusable(&e))?;

    let (first, end) = cut.frames(f64::from(rate_hz));
    let mut channels: Vec<Vec<f64>> = Vec::new();
    let (mut packet_channels, mut position) = (Vec::new(), 0usize);
    while position < end {
        let packet = match format.next_packet() {
            Ok(Some(packet)) => packet,
            Ok(None) => break,
            Err(WavError::IoError(e)) if e.kind() == std::io::ErrorKind::UnexpectedEof => break,
            Err(e) => return Err(unusable(&e)),
        };
        let decoded = decoder.decode(&packet).map_err(|e| unusable(&e))?;
        let frames = decoded.frames();
        if decoded.num_planes() > MAX_CHANNELS {
            let problem = format!(
                "{} channels: give 1 to {MAX_CHANNELS}, one per axis",
                decoded.num_planes()
            );
            return Err(Error::file(path, problem));
        }
        decoded.copy_to_vecs_planar(&mut packet_channels);
        channels.resize(packet_channels.len(), Vec::new());
        let from = first.saturating_sub(position).min(frames);
        let to = (end - position).min(frames);
        for (channel, samples) in channels.iter_mut().zip(&packet_channels) {
            channel.extend_from_slice(&samples[from..to.max(from)]);
        }
        let kept = channels.first().map_or(0, Vec::len);
        if let Some(fault) = length_fault(kept as f64) {
            return Err(Error::file(path, fault));
        }
        position += frames;
    }
    if let Some(declared) = declared_frames
        && (position as u64) < declared.min(end as u64)
    {
        let problem = format!(
            "is truncated: it holds {position} of {declared} samples; copy or record it again"
        );
        return Err(Error::file(path, problem));
    }
    Ok(Source {
        rate_hz: f64::from(rate_hz),
        first_frame: first,
        channels,
        times_s: None,
        truncation: declared_frames
            .and_then(|declared| truncation(declared, frame_bits, file_bytes)),
        timing: Timing::default(),
    })
}

/// Size of the shortest header, bytes.
const LEAST_HEADER: u64 = 44;

/// Returns the lengths of a file of `file_bytes` that cannot hold the frames that its header declares.
fn truncation(declared: u64, frame_bits: u64, file_bytes: u64) -> Option<Truncation> {
    let frame_bytes = (frame_bits / 8).max(1);
    let held = file_bytes.saturating_sub(LEAST_HEADER) / frame_bytes;
    (held < declared).then_some(Truncation { declared, held })
}

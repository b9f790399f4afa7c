//! Seeds of the host's parsers.

use std::error::Error;
use std::path::Path;

use host_tools::fit::Options;
use host_tools::fit::record::FitRecord;
use host_tools::recording::{RecordingSet, Trial};
use host_tools::support::bounded_file::Format;
use model_format::link::{BoardName, ImageHeader, ImageVersion, SIGNED_BYTES};

use super::large::{Piece, input};
use super::target_of;

#[path = "../../../../host-tools/fit/src/fit/hatt/fixture.rs"]
#[allow(missing_docs)]
mod hatt;

/// Seeds of one target: the target's name, and its inputs.
type Seeds<'a> = (&'a str, Vec<Vec<u8>>);

/// Writes the seeds of every parser.
pub fn write(root: &Path) -> Result<(), Box<dyn Error>> {
    let texts = |texts: &[&str]| texts.iter().map(|text| text.as_bytes().to_vec()).collect();
    let mut all: Vec<Seeds> = vec![
        ("trials", texts(&TRIALS)),
        ("recordings", recordings()),
        ("tables", texts(&TABLES)),
        ("scenes", texts(&SCENES)),
        (
            "rigs",
            texts(&[include_str!("../../../../host-tools/examples/rigs/paper-rig.toml")]),
        ),
        (
            "hatt",
            vec![hatt::whole().into_bytes(), hatt::scattered(4).into_bytes()],
        ),
        ("frames", frames()),
        (
            "settings",
            texts(&["coil-resistance\n8", "amplifier-gain\n1\npower-limit\n0.1"]),
        ),
        ("records", texts(&[&record()?])),
        ("updates", vec![update()]),
        ("listings", texts(&["own\nspectra/a.svg\n"])),
    ];
    let large = LARGE.map(|(format, head, repeated, tail)| {
        let [head, repeated, tail] = [head, repeated, tail].map(|text| [(0, text.as_bytes())]);
        input(format, [&head, &repeated, &tail])
    });
    let mut grown = large.to_vec();
    let mut before = vec!["decode"];
    for &format in Format::ALL {
        let Some(target) = target_of(format).filter(|target| !before.contains(target)) else {
            continue;
        };
        let seeds = all.iter().find(|(name, _)| *name == target);
        let (_, inputs) = seeds.unwrap_or_else(|| panic!("{format:?} has no seeds"));
        grown.extend(inputs.iter().flat_map(|file| repetitions(format, file)));
        before.push(target);
    }
    all.push(("large", grown));
    for (target, inputs) in all {
        let folder = root.join(target);
        std::fs::create_dir_all(&folder)?;
        for (number, input) in inputs.iter().enumerate() {
            std::fs::write(folder.join(number.to_string()), input)?;
        }
    }
    Ok(())
}

const TRIALS: [&str; 3] = [
    "file,texture,speed_mm_s,force_n\na.wav,denim,120,1.0\nb.wav,\"silk, raw\",140.5,1e-1\n",
    "\u{feff}# mine\nfile;texture;speed_mm_s;force_n;scale_m_s2;start_s;duration_s;sample_rate_hz;simulated;\r\n\
     a.wav;denim;120,5;1,0;98,1;0,5;2;5000;true;\r\n",
    "file\ttexture\tspeed_mm_s\tforce_n\na.wav\tdenim\t100\t1\nb.wav\tdenim\t100.0001\t1\n",
];

const TABLES: [&str; 7] = [
    "\0time_s,speed_mm_s,force_n\n0,0,0.5\n1.5,-120,0.8\n",
    "\0time_s;position_mm;contact;speed_mm_s;force_n\n0,5;1;1;100,5;-1\n1;2;0;9;1\n",
    "\u{1}# SIMULATED\ntime_s,speed_mm_s,force_n,x\n0,100,1,0.1\n0.0002,100,1,0.2\n0.0004,101,1,-0.1\n",
    "\u{1}time_s\tspeed_mm_s\tforce_n\tx\ty\n0\t100\t1\t0,1\t2\n0,0002\t-1e9\t1\t0,2\t3\n",
    "\u{2}listener,trial,pair,a,b,x,answer,correct,replays,seconds,page,origin\n\
     1,1,p,recording,fitted,fitted,B,1,0,12.5,0f,recorded\n\
     2,2,q,recording,gaussian,recording,B,0,3,1.5,0f,SIMULATED\n",
    "\u{3}speed_mm_s,force_n\n50,0.5\n100,1\n",
    "\u{3}texture;speed_mm_s;force_n\nsilk;50,5;0,5\n;100;1\n",
];

const SCENES: [&str; 2] = [
    "name = \"two\"\ntransition_mm = 4\n[[surface]]\ntexture = \"silk\"\ngain = 0.5\n[surface.tap]\n\
     frequency_hz = 240\ndecay_s = 0.012\ngain_m_s2_per_n_s = 0.1\nlimit_m_s2 = 40\n\
     [[surface]]\nname = \"sticky\"\ntexture = \"silk\"\n\
     [surface.stick_slip]\nperiod_mm = 1.5\nduty = 0.4\ndepth = 0.9\nbelow_mm_s = 60\nabove_n = 0.5\n[[region]]\n\
     surface = \"silk\"\nstart_mm = 0\nend_mm = 40\n[[region]]\nsurface = \"sticky\"\nstart_mm = 40\nend_mm = 80\n\
     [[equaliser.section]]\nkind = \"peaking\"\nfrequency_hz = 150\nq = 2\ngain_db = -6\n",
    "name = \"still\"\nsample_rate_hz = 5000\n[constant_motion]\nspeed_mm_s = -100\nforce_n = 1\n[[surface]]\n\
     texture = \"silk\"\n",
];

/// The record of a fit to one recording.
fn record() -> Result<String, host_tools::support::Error> {
    let set = RecordingSet {
        trials: vec![Trial::of("a.wav", "silk", 50.0, 1.0)],
        is_listed: true,
    };
    FitRecord::with_contents(&set, &Options::default(), b"a library", &[1]).to_text()
}

const LABVIEW: &str = "LabVIEW Measurement\t\nReader_Version\t2\nSeparator\tTab\nMulti_Headings\tNo\nX_Columns\tOne\n\
    ***End_of_Header***\t\n\t\nChannels\t2\t\t\nSamples\t3\t3\t\nY_Unit_Label\tg\tg\t\nX0\t0\t0\t\n\
    Delta_X\t0.001\t0.001\t\n***End_of_Header***\t\t\t\nX_Value\tx\ty\tComment\n0\t1\t2\n0.001\t2\t3\n0.002\t3\t1\n";

/// WAV files of integers and of floats, with other chunks before the samples, and tables.
fn recordings() -> Vec<Vec<u8>> {
    let chunk = |id: &[u8; 4], content: &[u8]| {
        let length = (content.len() as u32).to_le_bytes();
        [&id[..], &length, content].concat()
    };
    let wav = |format: u16, channels: u16, rate_hz: u32, bits: u16, data: &[u8]| {
        let frame = channels * bits / 8;
        let mut content = Vec::new();
        content.extend(format.to_le_bytes());
        content.extend(channels.to_le_bytes());
        content.extend(rate_hz.to_le_bytes());
        content.extend((rate_hz * u32::from(frame)).to_le_bytes());
        content.extend(frame.to_le_bytes());
        content.extend(bits.to_le_bytes());
        let body = [
            &b"WAVE"[..],
            &chunk(b"LIST", b"INFO"),
            &chunk(b"fmt ", &content),
            &chunk(b"data", data),
        ]
        .concat();
        chunk(b"RIFF", &body)
    };
    let floats: Vec<u8> = (0..60u8).flat_map(|n| (f32::from(n % 7) - 3.0).to_le_bytes()).collect();
    let words: Vec<u8> = (0..200u8).map(|n| n.wrapping_mul(37)).collect();
    let mut all = vec![
        wav(1, 1, 5000, 16, &words),
        wav(1, 2, 44_100, 8, &words),
        wav(1, 1, 100, 24, &words[..198]),
        wav(3, 3, 5000, 32, &floats),
    ];
    for text in [
        "\u{1}time_s,x\n0,1\n0.0002,2\n0.0004,3\n",
        "\u{1}time_s;x;y\n0;1,5;2\n0,0002;2;3\n",
        "\0\n1 2 3\n2 3 4\n",
        LABVIEW,
    ] {
        all.push(text.as_bytes().to_vec());
    }
    all
}

/// Grammars of large files: `file` with its last line repeated, with its last byte repeated, and with the second field
/// of each line repeated.
fn repetitions(format: Format, file: &[u8]) -> [Vec<u8>; 3] {
    let lines: Vec<Piece<'_>> = file
        .split_inclusive(|&byte| byte == b'\n')
        .map(|line| (0, line))
        .collect();
    let (last, head) = lines.split_last().expect("no seed is empty");
    let is_separator = |byte: &u8| b",;\t = ".contains(byte);
    let columns: Vec<Piece<'_>> = lines
        .iter()
        .flat_map(|(_, line)| {
            let first = line.iter().position(is_separator).unwrap_or(line.len());
            let second = line.iter().skip(first + 1).position(is_separator);
            let second = second.map_or(first, |second| first + 1 + second);
            [(0, &line[..first]), (13, &line[first..second]), (0, &line[second..])]
        })
        .collect();
    let (above, row) = columns.split_at(columns.len() - 3);
    let byte = [(0, &file[file.len() - 1..])];
    [[head, &[*last], &[]], [&lines, &byte, &[]], [above, row, &[]]].map(|grammar| input(format, grammar))
}

/// Head, repetition and tail of large files with many keys, chunks, names or levels.
const LARGE: [(Format, &str, &str, &str); 10] = [
    (Format::Table, "\0", "# \x1f = 1\n", "x\n1\n2\n"),
    (Format::Wave, "RIFF\0\0\0\x01WAVE", "LIST\0\0\0\0", ""),
    (
        Format::Strokes,
        "\x01time_us,speed_mm_s,force_n,x\n",
        "\x1f00,100,1,0.1\n",
        "",
    ),
    (
        Format::Trials,
        "file,texture,speed_mm_s,force_n\n",
        "\x1f,t\x1f,1\x1fe-5,1\n",
        "",
    ),
    (Format::Scene, "name = \"a\"\n", "[[surface]]\nname = \"\x1f\"\n", ""),
    (Format::Scene, "a", ".a", " = 1\n"),
    (Format::Record, "{", "\"k\x1f\":1,", ""),
    (Format::Record, "", "[", ""),
    (Format::Hatt, "<a", " k\x1f=\"1\"", "/>"),
    (Format::Listing, "own\n", "\x1f/\x1f.svg\n", ""),
];

/// An update with an image of four bytes, and a signature of zeros, which the device judges.
fn update() -> Vec<u8> {
    let header = ImageHeader {
        board: BoardName::new("NUCLEO-H743ZI2"),
        version: ImageVersion::new([1, 2, 3]),
        length: 4,
        digest: [7; 64],
    };
    let mut bytes = header.to_bytes().to_vec();
    bytes.resize(SIGNED_BYTES, 0);
    bytes.extend([1, 2, 3, 4]);
    bytes
}

/// Frames as a device sends them.
fn frames() -> Vec<Vec<u8>> {
    let messages: [&[u8]; 4] = [&[0; 40], &[1, 2, 3], &[0, 1, 0, 0, 5, 0], &[9; 300]];
    let mut stream = Vec::new();
    for message in messages {
        stream.extend(cobs::encode_vec(message));
        stream.push(0);
    }
    let mut all: Vec<Vec<u8>> = messages.iter().map(|message| message.to_vec()).collect();
    all.push(stream);
    all
}

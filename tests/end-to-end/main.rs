//! Tests of the command as a user runs it, with devices and links that fail. They are one program, because each test
//! program links the whole product.

mod command_line;
mod device_calibrate;
mod device_commands;
mod device_faults;
#[cfg(unix)]
mod device_links;
mod device_play;
mod device_record;
mod device_response;
mod device_self_test;
mod device_self_test_lines;
mod device_update;
mod drift;
mod evaluation;
mod fit_to_sound;
mod frontier;
mod hard_cases;
mod hard_fits;
#[path = "../../host-tools/fit/src/fit/hatt/fixture.rs"]
mod hatt;
mod hostile_inputs;
mod inputs;
#[cfg(target_os = "linux")]
mod large_sets;
mod liveliness;
#[cfg(target_os = "linux")]
mod outputs;
mod pages;
mod pin;
mod report_pages;
mod rig_noise;
mod rub_page;
mod scenes;
#[cfg(target_os = "linux")]
mod shell;
mod support;
mod ten_kilohertz;
mod triage;
#[cfg(target_os = "linux")]
mod two_programs;

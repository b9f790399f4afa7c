//! The command as a user runs it, and devices and links that fail: one program, because each links all of the product.

#[cfg(all(feature = "device", target_os = "linux"))]
mod broker;
mod command_line;
#[cfg(feature = "device")]
mod device_calibrate;
mod device_commands;
#[cfg(feature = "device")]
mod device_faults;
#[cfg(all(unix, feature = "device"))]
mod device_links;
#[cfg(feature = "device")]
mod device_record;
#[cfg(feature = "device")]
mod device_self_test;
#[cfg(feature = "device")]
mod device_self_test_lines;
mod drift;
mod evaluation;
mod fit_to_sound;
mod frontier;
mod hard_cases;
mod hard_fits;
#[path = "../../host-tools/src/fit/hatt/fixture.rs"]
mod hatt;
#[cfg(all(feature = "device", feature = "hatt"))]
mod hostile_inputs;
mod inputs;
#[cfg(target_os = "linux")]
mod large_sets;
mod liveliness;
#[cfg(all(target_os = "linux", feature = "device", feature = "hatt"))]
mod outputs;
mod pages;
#[cfg(feature = "device")]
mod pin;
mod report_pages;
mod rub_page;
mod scenes;
#[cfg(target_os = "linux")]
mod shell;
mod support;
mod ten_kilohertz;
mod triage;

// A control loop at 1 kHz and an audio callback in another thread: two_threads LIBRARY SECONDS
//
// In a rig the loop reads a device, and the callback is PortAudio's or a DAQ's. Here a clock calls it.
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <thread>
#include <vector>

#include "stylus_player.hpp"

int main(int count, char **arguments)
try {
    if (count != 3) {
        std::fprintf(stderr, "usage: %s LIBRARY SECONDS\n", arguments[0]);
        return 2;
    }
    using clock = std::chrono::steady_clock;
    constexpr unsigned rate_hz = 48000;
    constexpr std::size_t buffer = 240; // 5 ms
    const double seconds = std::atof(arguments[2]);

    stylus::player player(rate_hz);
    {
        const stylus::library library = stylus::library::open(arguments[1]);
        player.choose(library, library.texture(library.texture_names().front()), 1);
    } // The player keeps what it plays.
    player.set_gain(0.05f, 1.0f); // V per m/s², and at most 1 V

    std::atomic<bool> is_over{false};
    std::thread control([&] {
        auto next = clock::now();
        for (double time_s = 0.0; !is_over; time_s += 0.001) {
            const double position_mm = 40.0 * std::sin(2.0 * time_s);
            player.reach(time_s, position_mm, 0.8);
            std::this_thread::sleep_until(next += std::chrono::milliseconds(1));
        }
    });

    std::vector<float> samples(buffer);
    double power = 0.0;
    float peak = 0.0f;
    const auto buffers = static_cast<unsigned long>(seconds * rate_hz / buffer);
    bool failed = false;
    auto next = clock::now();
    // And until something is heard, because a busy system may begin the other thread late.
    unsigned long index = 0;
    for (; (index < buffers || power == 0.0) && !failed; index++) {
        std::this_thread::sleep_until(next += std::chrono::microseconds(5000));
        failed = player.fill(samples.data(), samples.size()) != STYLUS_OK;
        for (const float sample : samples) {
            power += sample * sample;
            peak = std::fmax(peak, std::fabs(sample));
        }
    }
    is_over = true;
    control.join();
    const double rms_v = std::sqrt(power / (static_cast<double>(index) * buffer));
    std::printf("%.6f V RMS, %.6f V at most\n", rms_v, peak);
    return failed || peak > 1.0f;
} catch (const std::exception &fault) {
    std::fprintf(stderr, "%s\n", fault.what());
    return 1;
}

// A texture on the default output by PortAudio, for a voice coil on a headphone jack:
//
//     c++ -std=c++17 -pthread -I include examples/headphones.cpp -L lib -lstylusplayer -lportaudio -o headphones
//     ./headphones LIBRARY [TEXTURE [V_PER_M_S2 [FULL_SCALE_V [SECONDS]]]]
//
// Strokes by the clock take the place of a device. FULL_SCALE_V is the peak of your jack for a full-scale sine, 1 V
// until you have measured it, because cards and volume controls differ. V_PER_M_S2 is your actuator's, 0.05 until then.
// Ends with 1 if the player or PortAudio failed, and with 3 if the player needed more of the processor's time for a
// buffer than the buffer lasts.
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <stdexcept>
#include <string>
#include <thread>

#include <portaudio.h>
#include <time.h>

#include "stylus_player.hpp"

namespace {

constexpr unsigned long buffer = 256;
constexpr double limit_v = 1.0;

void check(PaError status)
{
    if (status < 0)
        throw std::runtime_error(std::string("PortAudio: ") + Pa_GetErrorText(status));
}

/// What the callback plays and counts. Others read the counts when the stream has stopped, but for `heard`: the frames
/// so far, once one of them was not silent.
struct playback {
    stylus::player player;
    double rate_hz;
    std::atomic<unsigned long> heard{0};
    unsigned long frames = 0, underflows = 0, failures = 0, late = 0;
    double worst_share = 0.0, power = 0.0;
};

/// Time that this thread has had of a processor, s: what others take from it is no fault of the player.
double processor_s()
{
    timespec time{};
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &time);
    return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

int play(const void *, void *output, unsigned long frames, const PaStreamCallbackTimeInfo *,
         PaStreamCallbackFlags flags, void *data)
{
    auto &playback = *static_cast<struct playback *>(data);
    auto *samples = static_cast<float *>(output);
    const double begin_s = processor_s();
    const bool failed = playback.player.fill(samples, frames) != STYLUS_OK;
    const double share = (processor_s() - begin_s) * playback.rate_hz / static_cast<double>(frames);
    // To both channels, from the end, because both lie where one was.
    for (unsigned long index = frames; index-- > 0;) {
        playback.power += samples[index] * samples[index];
        samples[2 * index] = samples[2 * index + 1] = samples[index];
    }
    playback.frames += frames;
    if (playback.power > 0.0)
        playback.heard = playback.frames;
    playback.failures += failed;
    playback.late += share > 1.0;
    playback.worst_share = std::fmax(playback.worst_share, share);
    playback.underflows += (flags & paOutputUnderflow) != 0;
    return paContinue;
}

/// Strokes of 80 mm, there and back in 2 s, with 0.8 N, until `is_over`.
void stroke(stylus::player &player, const std::atomic<bool> &is_over)
{
    using clock = std::chrono::steady_clock;
    const double pi = std::acos(-1.0);
    const auto begin = clock::now();
    for (auto next = begin; !is_over; std::this_thread::sleep_until(next += std::chrono::milliseconds(1))) {
        const double time_s = std::chrono::duration<double>(clock::now() - begin).count();
        player.reach(time_s, 40.0 * std::sin(pi * time_s), 0.8);
    }
    player.stop();
}

struct portaudio {
    portaudio() { check(Pa_Initialize()); }
    ~portaudio() { Pa_Terminate(); }
};

} // namespace

int main(int count, char **arguments)
try {
    const auto number = [&](int index, double otherwise) {
        return count > index ? std::atof(arguments[index]) : otherwise;
    };
    const double v_per_m_s2 = number(3, 0.05), full_scale_v = number(4, 1.0), seconds = number(5, 10.0);
    if (count < 2 || count > 6 || v_per_m_s2 <= 0.0 || full_scale_v <= 0.0 || seconds <= 0.0) {
        std::fprintf(stderr, "usage: %s LIBRARY [TEXTURE [V_PER_M_S2 [FULL_SCALE_V [SECONDS]]]]\n", arguments[0]);
        return 2;
    }
    const stylus::library library = stylus::library::open(arguments[1]);
    const std::string texture = count > 2 ? arguments[2] : library.texture_names().at(0);
    const std::size_t index = library.texture(texture);

    const portaudio session;
    const PaDeviceIndex device = Pa_GetDefaultOutputDevice();
    if (device == paNoDevice)
        throw std::runtime_error("PortAudio finds no output");
    const PaDeviceInfo &about = *Pa_GetDeviceInfo(device);
    const double rate_hz = about.defaultSampleRate;
    playback playback{stylus::player(static_cast<std::uint32_t>(rate_hz)), rate_hz};
    const auto frames = static_cast<unsigned long>(seconds * rate_hz);
    playback.player.choose(library, index, 1);
    playback.player.set_gain(static_cast<float>(v_per_m_s2 / full_scale_v),
                             static_cast<float>(std::fmin(1.0, limit_v / full_scale_v)));
    std::printf("'%s' on '%s' at %.0f Hz: %g V per m/s2, at most %g V if full scale is %g V\n", texture.c_str(),
                about.name, rate_hz, v_per_m_s2, std::fmin(limit_v, full_scale_v), full_scale_v);

    const PaStreamParameters output{device, 2, paFloat32, about.defaultLowOutputLatency, nullptr};
    PaStream *stream = nullptr;
    check(Pa_OpenStream(&stream, nullptr, &output, rate_hz, buffer, paNoFlag, play, &playback));
    std::atomic<bool> is_over{false};
    std::thread control([&] { stroke(playback.player, is_over); });
    const PaError started = Pa_StartStream(stream);
    // By the samples that were taken, because a busy system may take them late.
    while (started == paNoError && Pa_IsStreamActive(stream) == 1 && playback.heard < frames)
        Pa_Sleep(10);
    is_over = true;
    control.join();
    Pa_Sleep(50); // What plays fades.
    check(started);
    check(Pa_StopStream(stream));

    const double rms_v = full_scale_v * std::sqrt(playback.power / static_cast<double>(playback.frames));
    std::printf("%lu samples, %.6f V RMS\n", playback.frames, rms_v);
    std::printf("buffers: %lu failed, %lu late, the slowest took %.3f of its time; PortAudio told %lu underflows\n",
                playback.failures, playback.late, playback.worst_share, playback.underflows);
    if (playback.failures > 0 || playback.heard < frames)
        return 1;
    return playback.late > 0 ? 3 : 0;
} catch (const std::exception &fault) {
    std::fprintf(stderr, "%s\n", fault.what());
    return 1;
}

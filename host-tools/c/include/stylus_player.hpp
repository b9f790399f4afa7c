// Textures and scenes of a library in real time, for C++17. See README.md.
#ifndef STYLUS_PLAYER_HPP
#define STYLUS_PLAYER_HPP

#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <stdexcept>
#include <string>
#include <vector>

#include "stylus_player.h"

namespace stylus {

/// A call that failed, with its status and what it says.
class error : public std::runtime_error {
public:
    explicit error(stylus_status status) : std::runtime_error(text(status)), status_(status) {}

    stylus_status status() const noexcept { return status_; }

private:
    static std::string text(stylus_status status)
    {
        std::string said = stylus_status_text(status);
        char more[512];
        if (stylus_last_text(more, sizeof more) == STYLUS_OK && more[0] != 0)
            said += std::string(": ") + more;
        return said;
    }

    stylus_status status_;
};

inline void check(stylus_status status)
{
    if (status != STYLUS_OK)
        throw error(status);
}

/// A library. What plays from it may outlive it.
class library {
public:
    static library open(const std::string &path)
    {
        stylus_library *opened = nullptr;
        check(stylus_library_open(path.c_str(), &opened));
        return library(opened);
    }

    static library decode(const std::uint8_t *bytes, std::size_t length)
    {
        stylus_library *opened = nullptr;
        check(stylus_library_decode(bytes, length, &opened));
        return library(opened);
    }

    std::vector<std::string> texture_names() const { return names(STYLUS_TEXTURE); }
    std::vector<std::string> scene_names() const { return names(STYLUS_SCENE); }
    std::size_t texture(const std::string &name) const { return find(STYLUS_TEXTURE, name); }
    std::size_t scene(const std::string &name) const { return find(STYLUS_SCENE, name); }
    const stylus_library *get() const noexcept { return handle_.get(); }

private:
    struct closer {
        void operator()(stylus_library *handle) const noexcept { stylus_library_close(handle); }
    };

    explicit library(stylus_library *handle) : handle_(handle) {}

    std::vector<std::string> names(std::uint32_t kind) const
    {
        std::size_t count = 0;
        check(stylus_library_count(get(), kind, &count));
        std::vector<std::string> names;
        for (std::size_t index = 0; index < count; index++) {
            char name[64];
            check(stylus_library_name(get(), kind, index, name, sizeof name));
            names.emplace_back(name);
        }
        return names;
    }

    std::size_t find(std::uint32_t kind, const std::string &name) const
    {
        std::size_t index = 0;
        check(stylus_library_find(get(), kind, name.c_str(), &index));
        return index;
    }

    std::unique_ptr<stylus_library, closer> handle_;
};

/// A player. One thread at a time may fill; any may do the rest.
class player {
public:
    /// `as_rendered` leaves the DC blocker out, for the bits of `stylus render`.
    explicit player(std::uint32_t output_rate_hz, bool as_rendered = false)
    {
        stylus_player *opened = nullptr;
        check((as_rendered ? stylus_player_open_as_rendered : stylus_player_open)(output_rate_hz, &opened));
        handle_.reset(opened);
    }

    void choose(const library &from, std::size_t texture, std::uint64_t seed)
    {
        check(stylus_player_choose(get(), from.get(), STYLUS_TEXTURE, texture, seed));
    }

    void choose_scene(const library &from, std::size_t scene, std::uint64_t seed)
    {
        check(stylus_player_choose(get(), from.get(), STYLUS_SCENE, scene, seed));
    }

    void stop() { check(stylus_player_stop(get())); }

    /// Volts, if `gain` is in V per m/s².
    void set_gain(float gain, float limit = std::numeric_limits<float>::infinity())
    {
        check(stylus_player_set_gain(get(), gain, limit));
    }

    /// The output is the coil's voltage, whose size, slew and power are limited for good.
    void set_coil(float ohms, float volts_per_m_s2, float watts)
    {
        check(stylus_player_set_coil(get(), ohms, volts_per_m_s2, watts));
    }

    void move(double speed_mm_s, double force_n) { check(stylus_player_move(get(), speed_mm_s, force_n)); }

    void reach(double time_s, double position_mm, double force_n)
    {
        check(stylus_player_reach(get(), time_s, position_mm, force_n));
    }

    void follow(const stylus_motion &motion) { check(stylus_player_follow(get(), &motion)); }

    /// For the audio thread: throws nothing, and leaves silence where it fails.
    stylus_status fill(float *samples, std::size_t length) noexcept
    {
        const stylus_status status = stylus_player_fill(get(), samples, length);
        if (status != STYLUS_OK && samples != nullptr)
            for (std::size_t index = 0; index < length; index++)
                samples[index] = 0.0f;
        return status;
    }

    stylus_player *get() const noexcept { return handle_.get(); }

private:
    struct closer {
        void operator()(stylus_player *handle) const noexcept { stylus_player_close(handle); }
    };

    std::unique_ptr<stylus_player, closer> handle_;
};

} // namespace stylus

#endif

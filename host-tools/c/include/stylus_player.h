// Textures and scenes of a library in real time: see README.md.
//
// cbindgen makes this file of host-tools/c/src. Functions take addresses that are NULL or lead to what their types say,
// and handles that nobody closes meanwhile.

#ifndef STYLUS_PLAYER_H
#define STYLUS_PLAYER_H

#include <stddef.h>
#include <stdint.h>

// A library.
typedef struct stylus_library stylus_library;

// A player.
typedef struct stylus_player stylus_player;

// Number of this interface. A change that old callers would notice raises it.
#define STYLUS_PLAYER_ABI 1

// Result of a call.
typedef enum stylus_status {
  // The call did what it says.
  STYLUS_OK = 0,
  // An argument is NULL.
  STYLUS_NULL = 1,
  // A handle is none of this library, or was closed.
  STYLUS_HANDLE = 2,
  // An address is not a multiple of its type's alignment.
  STYLUS_ALIGNMENT = 3,
  // A length is beyond what memory can hold, or a buffer is too short for its text.
  STYLUS_LENGTH = 4,
  // A text is not UTF-8.
  STYLUS_TEXT = 5,
  // A file cannot be read.
  STYLUS_FILE = 6,
  // The bytes are no library, or a damaged one.
  STYLUS_LIBRARY = 7,
  // The library has no such texture or scene, or it cannot be played.
  STYLUS_CHOICE = 8,
  // A speed, force, position or time is not finite, or no hand has it.
  STYLUS_MOTION = 9,
  // The output rate is not played.
  STYLUS_RATE = 10,
  // The gain, the limit or the coil cannot be.
  STYLUS_GAIN = 11,
  // Another thread fills from this player at this moment.
  STYLUS_BUSY = 12,
  // A fault of this library. The handle is of no more use, except to be closed.
  STYLUS_FAULT = 13,
} stylus_status;

// Kind of what is played.
typedef enum stylus_kind {
  // A texture, everywhere and without effects.
  STYLUS_TEXTURE = 0,
  // A scene.
  STYLUS_SCENE = 1,
} stylus_kind;

// Motion of one block of 2 ms. NaN is for what is not known: both positions follow from the speed then, and contact
// from the force.
typedef struct stylus_motion {
  // Tangential speed, mm/s, signed by the direction.
  double speed_mm_s;
  // Normal force, N.
  double force_n;
  // Position at the block's first sample, mm.
  double begin_mm;
  // Position at the block's last sample, mm.
  double end_mm;
  // Contact: 0, or another number.
  double contact;
} stylus_motion;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Opens the library in a file, whose path is UTF-8, and writes its handle to `library`.
enum stylus_status stylus_library_open(const char *path, stylus_library **library);

// Decodes the library in `length` bytes, which it copies, and writes its handle to `library`.
enum stylus_status stylus_library_decode(const uint8_t *bytes, size_t length, stylus_library **library);

// Closes a library. Players that play from it keep what they need. NULL is none.
enum stylus_status stylus_library_close(stylus_library *library);

// Writes the number of textures or scenes to `count`. `kind` is a `stylus_kind`.
enum stylus_status stylus_library_count(const stylus_library *library, uint32_t kind, size_t *count);

// Writes the name of a texture or scene, with a 0 at its end, to `length` bytes at `name`; 64 suffice.
enum stylus_status stylus_library_name(const stylus_library *library,
                                       uint32_t kind,
                                       size_t index,
                                       char *name,
                                       size_t length);

// Writes the number of the texture or scene with a name to `index`.
enum stylus_status stylus_library_find(const stylus_library *library, uint32_t kind, const char *name, size_t *index);

// Makes a player of an output rate, which plays nothing yet, and writes its handle to `player`.
// Rates are multiples of 25 Hz from 1000 to 192000 Hz.
enum stylus_status stylus_player_open(uint32_t output_rate_hz, stylus_player **player);

// The same without the DC blocker: at a texture's own rate, samples are those of `stylus render`, to the bit. Not for
// an amplifier that passes a steady voltage on.
enum stylus_status stylus_player_open_as_rendered(uint32_t output_rate_hz, stylus_player **player);

// Closes a player. No thread may move any more, or begin to fill; while one fills, `STYLUS_BUSY` is returned and the
// player stays open. NULL is none.
enum stylus_status stylus_player_close(stylus_player *player);

// Plays a texture or scene with the noise of `seed`, as soon as what sounds has faded. From any thread; it allocates.
enum stylus_status stylus_player_choose(const stylus_player *player,
                                        const stylus_library *library,
                                        uint32_t kind,
                                        size_t index,
                                        uint64_t seed);

// Lets what sounds fade, and plays nothing until the next choice. From any thread; it allocates.
enum stylus_status stylus_player_stop(const stylus_player *player);

// Moves at a speed, signed by the direction, with a force; held for 50 ms and the length of a buffer. From any
// thread, without waiting.
enum stylus_status stylus_player_move(const stylus_player *player, double speed_mm_s, double force_n);

// Moves to a position with a force at a time of the caller's clock; the speed is that from the position before.
// From any thread, without waiting.
enum stylus_status stylus_player_reach(const stylus_player *player, double time_s, double position_mm, double force_n);

// Moves as `motion` says in the next block, and on at its speed. From any thread, without waiting.
enum stylus_status stylus_player_follow(const stylus_player *player, const struct stylus_motion *motion);

// Multiplies what is played, m/s2, by `gain`, and clamps it to `limit` on either side. The gain changes over 2 ms,
// the limit at once. From any thread, without waiting.
enum stylus_status stylus_player_set_gain(const stylus_player *player, float gain, float limit);

// Protects a coil, for as long as the player lives, by its resistance, the volts for each m/s2, and its lasting power.
// The volts become the gain, and the output is the coil's voltage. It is then at most four times that at this power,
// reaches it in 0.4 ms or more, and is attenuated before its mean power over 10 s exceeds the limit. Behind an
// amplifier of gain a, give ohms / a^2 and volts / a. From any thread, without waiting.
enum stylus_status stylus_player_set_coil(const stylus_player *player, float ohms, float volts_per_m_s2, float watts);

// Plays the next `length` samples into `samples`. Only one thread at a time may call the function: another gets
// `STYLUS_BUSY`. The call allocates nothing, takes no lock and makes no system call. Its time per sample is bounded.
enum stylus_status stylus_player_fill(const stylus_player *player, float *samples, size_t length);

// Writes the time from a move to the middle of the change that it makes, s, to `seconds`, for a texture at
// `sample_rate_hz`, 5000 or 10000. It is at most so much in the mean, and 1 ms more for a move just after a block
// began.
enum stylus_status stylus_player_latency(uint32_t sample_rate_hz, uint32_t output_rate_hz, double *seconds);

// Writes the band, Hz, of a texture at `sample_rate_hz`, 5000 or 10000, that an output rate has left to `hz`.
enum stylus_status stylus_player_band(uint32_t sample_rate_hz, uint32_t output_rate_hz, double *hz);

// Writes the text of this thread's last failure, with a 0 at its end, to `length` bytes at `buffer`. It is empty if
// the status of that failure says all.
enum stylus_status stylus_last_text(char *buffer, size_t length);

// Meaning of a status: a text that stays. An unknown status has one too.
const char *stylus_status_text(int32_t status);

// Number of this interface: STYLUS_PLAYER_ABI of the header that it was built with.
uint32_t stylus_player_abi(void);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* STYLUS_PLAYER_H */

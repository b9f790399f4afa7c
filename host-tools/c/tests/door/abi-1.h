#define STYLUS_PLAYER_ABI 1

typedef enum stylus_status {
  STYLUS_OK = 0,
  STYLUS_NULL = 1,
  STYLUS_HANDLE = 2,
  STYLUS_ALIGNMENT = 3,
  STYLUS_LENGTH = 4,
  STYLUS_TEXT = 5,
  STYLUS_FILE = 6,
  STYLUS_LIBRARY = 7,
  STYLUS_CHOICE = 8,
  STYLUS_MOTION = 9,
  STYLUS_RATE = 10,
  STYLUS_GAIN = 11,
  STYLUS_BUSY = 12,
  STYLUS_FAULT = 13,
} stylus_status;

typedef enum stylus_kind {
  STYLUS_TEXTURE = 0,
  STYLUS_SCENE = 1,
} stylus_kind;

typedef struct stylus_motion {
  double speed_mm_s;
  double force_n;
  double begin_mm;
  double end_mm;
  double contact;
} stylus_motion;

enum stylus_status stylus_library_open(const char *path, stylus_library **library);

enum stylus_status stylus_library_decode(const uint8_t *bytes, size_t length, stylus_library **library);

enum stylus_status stylus_library_close(stylus_library *library);

enum stylus_status stylus_library_count(const stylus_library *library, uint32_t kind, size_t *count);

enum stylus_status stylus_library_name(const stylus_library *library,
                                       uint32_t kind,
                                       size_t index,
                                       char *name,
                                       size_t length);

enum stylus_status stylus_library_find(const stylus_library *library, uint32_t kind, const char *name, size_t *index);

enum stylus_status stylus_player_open(uint32_t output_rate_hz, stylus_player **player);

enum stylus_status stylus_player_open_as_rendered(uint32_t output_rate_hz, stylus_player **player);

enum stylus_status stylus_player_close(stylus_player *player);

enum stylus_status stylus_player_choose(const stylus_player *player,
                                        const stylus_library *library,
                                        uint32_t kind,
                                        size_t index,
                                        uint64_t seed);

enum stylus_status stylus_player_stop(const stylus_player *player);

enum stylus_status stylus_player_move(const stylus_player *player, double speed_mm_s, double force_n);

enum stylus_status stylus_player_reach(const stylus_player *player, double time_s, double position_mm, double force_n);

enum stylus_status stylus_player_follow(const stylus_player *player, const struct stylus_motion *motion);

enum stylus_status stylus_player_set_gain(const stylus_player *player, float gain, float limit);

enum stylus_status stylus_player_set_coil(const stylus_player *player, float ohms, float volts_per_m_s2, float watts);

enum stylus_status stylus_player_fill(const stylus_player *player, float *samples, size_t length);

enum stylus_status stylus_player_latency(uint32_t sample_rate_hz, uint32_t output_rate_hz, double *seconds);

enum stylus_status stylus_player_band(uint32_t sample_rate_hz, uint32_t output_rate_hz, double *hz);

enum stylus_status stylus_last_text(char *buffer, size_t length);

const char *stylus_status_text(int32_t status);

uint32_t stylus_player_abi(void);

/* Measures the player by its C interface, at the texture's own rate: noise, interpolation of the model every 2 ms,
 * level, filter and safety stages, in buffers of 256 samples, with a motion told before each.
 *
 * player FOLDER SAMPLES SPEED_MM_S FORCE_N
 */
#include "peer.h"
#include "stylus_player.h"

static float samples[MOST_SAMPLES];

static void check(stylus_status status)
{
    must(status == STYLUS_OK, stylus_status_text(status));
}

int main(int count, char **arguments)
{
    must(count == 5, "player FOLDER SAMPLES SPEED_MM_S FORCE_N");
    char path[4096];
    snprintf(path, sizeof path, "%s/textures.lib", arguments[1]);
    size_t length = strtoul(arguments[2], NULL, 10);
    double speed_mm_s = atof(arguments[3]), force_n = atof(arguments[4]);
    must(length <= MOST_SAMPLES, "too many samples");

    stylus_library *library;
    stylus_player *player;
    check(stylus_library_open(path, &library));
    check(stylus_player_open(5000, &player));
    check(stylus_player_choose(player, library, STYLUS_TEXTURE, 0, 1));

    double begin = processor_ns();
    for (size_t sample = 0; sample + BLOCK <= length; sample += BLOCK) {
        check(stylus_player_move(player, speed_mm_s, force_n));
        check(stylus_player_fill(player, samples + sample, BLOCK));
    }
    finish(samples, length, processor_ns() - begin);
    check(stylus_player_close(player));
    check(stylus_library_close(library));
}

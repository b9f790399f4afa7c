/* Every call, rightly and with handles of the wrong kind: mistakes LIBRARY. For valgrind, and without a closed handle,
 * whose memory is no longer the caller's to name. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "stylus_player.h"

#define EXPECT(expected, call)                                                                                        \
    do {                                                                                                               \
        int status = (call);                                                                                           \
        if (status != (expected)) {                                                                                    \
            fprintf(stderr, "line %d: %s\n", __LINE__, stylus_status_text(status));                                    \
            return 1;                                                                                                  \
        }                                                                                                              \
    } while (0)

int main(int count, char **arguments)
{
    stylus_library *library;
    stylus_player *player;
    /* On the heap, where a byte too far is seen. */
    enum { FRAMES = 4097 };
    float *samples = malloc(FRAMES * sizeof *samples);
    uint64_t *other = calloc(1, sizeof *other);
    char name[64];
    size_t number;
    double seconds;
    stylus_motion motion = {.speed_mm_s = 100, .force_n = 1, .begin_mm = NAN, .end_mm = NAN, .contact = NAN};

    if (count != 2 || samples == NULL || other == NULL)
        return 2;
    EXPECT(STYLUS_OK, stylus_library_open(arguments[1], &library));
    EXPECT(STYLUS_OK, stylus_player_open(44100, &player));
    EXPECT(STYLUS_OK, stylus_library_count(library, STYLUS_TEXTURE, &number));
    EXPECT(STYLUS_OK, stylus_library_name(library, STYLUS_TEXTURE, 0, name, sizeof name));
    EXPECT(STYLUS_OK, stylus_library_find(library, STYLUS_TEXTURE, name, &number));
    EXPECT(STYLUS_OK, stylus_player_latency(5000, 44100, &seconds));
    for (int time = 0; time < 3; time++) {
        EXPECT(STYLUS_OK, stylus_player_choose(player, library, STYLUS_TEXTURE, 0, 1));
        EXPECT(STYLUS_OK, stylus_player_set_gain(player, 0.1f, 1.0f));
        EXPECT(STYLUS_OK, stylus_player_set_coil(player, 8.0f, 0.01f, 0.1f));
        EXPECT(STYLUS_OK, stylus_player_move(player, 120, 0.8));
        EXPECT(STYLUS_OK, stylus_player_fill(player, samples, FRAMES));
        EXPECT(STYLUS_OK, stylus_player_reach(player, 0.1 * time, time, 0.8));
        EXPECT(STYLUS_OK, stylus_player_fill(player, samples, 1));
        EXPECT(STYLUS_OK, stylus_player_follow(player, &motion));
        EXPECT(STYLUS_OK, stylus_player_fill(player, samples, FRAMES));
        EXPECT(STYLUS_OK, stylus_player_stop(player));
    }

    /* A library and 8 bytes of anything are smaller than a player. */
    stylus_player *wrong[] = {(stylus_player *)library, (stylus_player *)other};
    for (int index = 0; index < 2; index++) {
        EXPECT(STYLUS_HANDLE, stylus_player_fill(wrong[index], samples, FRAMES));
        EXPECT(STYLUS_HANDLE, stylus_player_move(wrong[index], 1, 1));
        EXPECT(STYLUS_HANDLE, stylus_player_reach(wrong[index], 0, 1, 1));
        EXPECT(STYLUS_HANDLE, stylus_player_follow(wrong[index], &motion));
        EXPECT(STYLUS_HANDLE, stylus_player_stop(wrong[index]));
        EXPECT(STYLUS_HANDLE, stylus_player_set_gain(wrong[index], 1, 1));
        EXPECT(STYLUS_HANDLE, stylus_player_set_coil(wrong[index], 1, 1, 1));
        EXPECT(STYLUS_HANDLE, stylus_player_choose(wrong[index], library, STYLUS_TEXTURE, 0, 1));
        EXPECT(STYLUS_HANDLE, stylus_player_close(wrong[index]));
    }
    EXPECT(STYLUS_HANDLE, stylus_player_choose(player, (stylus_library *)other, STYLUS_TEXTURE, 0, 1));
    EXPECT(STYLUS_HANDLE, stylus_library_count((stylus_library *)player, STYLUS_TEXTURE, &number));
    EXPECT(STYLUS_HANDLE, stylus_library_close((stylus_library *)player));
    EXPECT(STYLUS_NULL, stylus_player_fill(NULL, samples, FRAMES));
    EXPECT(STYLUS_LENGTH, stylus_library_name(library, STYLUS_TEXTURE, 0, name, 1));
    EXPECT(STYLUS_CHOICE, stylus_player_choose(player, library, STYLUS_TEXTURE, 99, 1));

    /* What plays keeps its library. */
    EXPECT(STYLUS_OK, stylus_library_close(library));
    EXPECT(STYLUS_OK, stylus_player_fill(player, samples, FRAMES));
    EXPECT(STYLUS_OK, stylus_player_close(player));
    free(samples);
    free(other);
    return 0;
}

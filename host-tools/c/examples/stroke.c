/* Plays a motion to a WAV file: stroke LIBRARY TEXTURE MOTION.csv OUT.wav
 *
 * The motion is one of `stylus render --motion`: time_s,speed_mm_s,force_n,position_mm. At the rate of the texture the
 * samples are those of `stylus render` with seed 1 to the bit, because the player is opened as rendered. Compile with -ffp-contract=off, for the same rounding.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "stylus_player.h"

enum { RATE_HZ = 5000, BLOCK = RATE_HZ / 500, COLUMNS = 4, MOST_ROWS = 100000 };

static double rows[MOST_ROWS][COLUMNS];
static size_t row_count;

static void check(stylus_status status)
{
    char text[256];
    if (status == STYLUS_OK)
        return;
    if (stylus_last_text(text, sizeof text) != STYLUS_OK)
        text[0] = 0;
    fprintf(stderr, "%s. %s\n", stylus_status_text(status), text);
    exit(1);
}

static void read_motion(const char *path)
{
    char line[256];
    FILE *file = fopen(path, "r");
    if (file == NULL || fgets(line, sizeof line, file) == NULL) {
        perror(path);
        exit(1);
    }
    while (row_count < MOST_ROWS && fgets(line, sizeof line, file) != NULL) {
        double *row = rows[row_count++];
        if (sscanf(line, "%lf,%lf,%lf,%lf", &row[0], &row[1], &row[2], &row[3]) != COLUMNS) {
            fprintf(stderr, "%s: line %zu has not four numbers\n", path, row_count + 1);
            exit(1);
        }
        /* A file's motion is in single precision. */
        for (int column = 1; column < COLUMNS; column++)
            row[column] = (float)row[column];
    }
    fclose(file);
}

/* Linear between rows, held before the first and after the last. */
static double motion_at(double time_s, int column)
{
    size_t after = 0;
    while (after < row_count && rows[after][0] <= time_s)
        after++;
    if (after == 0)
        return rows[0][column];
    const double *before = rows[after - 1];
    if (after == row_count)
        return before[column];
    const double *next = rows[after];
    double fraction = (time_s - before[0]) / (next[0] - before[0]);
    return before[column] + (next[column] - before[column]) * fraction;
}

static void put32(FILE *file, unsigned long number)
{
    for (int shift = 0; shift < 32; shift += 8)
        putc((int)(number >> shift & 0xff), file);
}

/* The header of a mono WAV file of 32-bit floats, 3 in its format. */
static void write_header(FILE *file, unsigned long samples)
{
    fputs("RIFF", file);
    put32(file, 36 + 4 * samples);
    fputs("WAVEfmt ", file);
    put32(file, 16);
    put32(file, 3 | 1 << 16);
    put32(file, RATE_HZ);
    put32(file, 4 * RATE_HZ);
    put32(file, 4 | 32ul << 16);
    fputs("data", file);
    put32(file, 4 * samples);
}

int main(int count, char **arguments)
{
    if (count != 5) {
        fprintf(stderr, "usage: %s LIBRARY TEXTURE MOTION.csv OUT.wav\n", arguments[0]);
        return 2;
    }
    if (stylus_player_abi() != STYLUS_PLAYER_ABI) {
        fprintf(stderr, "this library is of another version than stylus_player.h\n");
        return 1;
    }
    read_motion(arguments[3]);
    if (row_count == 0) {
        fprintf(stderr, "%s: no rows\n", arguments[3]);
        return 1;
    }

    stylus_library *library;
    stylus_player *player;
    size_t texture;
    check(stylus_library_open(arguments[1], &library));
    check(stylus_library_find(library, STYLUS_TEXTURE, arguments[2], &texture));
    check(stylus_player_open_as_rendered(RATE_HZ, &player));
    check(stylus_player_choose(player, library, STYLUS_TEXTURE, texture, 1));

    FILE *wav = fopen(arguments[4], "wb");
    if (wav == NULL) {
        perror(arguments[4]);
        return 1;
    }
    unsigned long blocks = (unsigned long)ceil(rows[row_count - 1][0] * RATE_HZ / BLOCK);
    write_header(wav, blocks * BLOCK);
    for (unsigned long block = 0; block < blocks; block++) {
        double begin_s = (double)(block * BLOCK) / RATE_HZ;
        double end_s = begin_s + (double)(BLOCK - 1) / RATE_HZ;
        stylus_motion motion = {
            .speed_mm_s = (float)motion_at(begin_s, 1),
            .force_n = (float)motion_at(begin_s, 2),
            .begin_mm = motion_at(begin_s, 3),
            .end_mm = motion_at(end_s, 3),
            .contact = NAN, /* by the force */
        };
        float samples[BLOCK];
        check(stylus_player_follow(player, &motion));
        check(stylus_player_fill(player, samples, BLOCK));
        for (int index = 0; index < BLOCK; index++) {
            unsigned int bits;
            memcpy(&bits, &samples[index], sizeof bits);
            put32(wav, bits);
        }
    }
    int failed = ferror(wav) | fclose(wav);
    check(stylus_player_close(player));
    check(stylus_library_close(library));
    if (failed)
        perror(arguments[4]);
    return failed != 0;
}

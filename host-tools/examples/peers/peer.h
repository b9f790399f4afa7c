/* What the programs in C share: a file as a whole, the processor's time, and the result of a measurement. */
#define _POSIX_C_SOURCE 200809L
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

enum { BLOCK = 256, MOST_SAMPLES = 1 << 18 };

/* Ends the program with a text, where something that must be is not. */
static inline void must(int is, const char *text)
{
    if (!is) {
        fprintf(stderr, "%s\n", text);
        exit(1);
    }
}

/* Reads at most `most` 32-bit words of a file of `prepare.py`, and returns their number. */
static inline size_t read_words(const char *folder, const char *name, int32_t *words, size_t most)
{
    char path[4096];
    must(snprintf(path, sizeof path, "%s/%s", folder, name) < (int)sizeof path, "the folder's name is too long");
    FILE *file = fopen(path, "rb");
    must(file != NULL, path);
    size_t count = fread(words, sizeof *words, most, file);
    fclose(file);
    return count;
}

/* Time that the processor has spent on this process, ns. */
static inline double processor_ns(void)
{
    struct timespec time;
    must(clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &time) == 0, "the processor's time cannot be read");
    return time.tv_sec * 1e9 + time.tv_nsec;
}

/* Writes the samples, 32 bits each, to stdout, and the time per sample to stderr. */
static inline void finish(const void *samples, size_t count, double ns)
{
    must(fwrite(samples, 4, count, stdout) == count, "the samples cannot be written");
    fprintf(stderr, "%g\n", ns / count);
}

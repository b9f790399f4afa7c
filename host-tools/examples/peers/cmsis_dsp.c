/* Measures CMSIS-DSP's lattice for q31, in buffers of 256 samples: the filter alone. Of its ladder only the last tap is
 * not 0, so that it is an all-pole filter.
 *
 * cmsis_dsp FOLDER SAMPLES
 */
#include "peer.h"
#include "dsp/filtering_functions.h"

enum { MOST_STAGES = 400 };

static q31_t noise[MOST_SAMPLES], samples[MOST_SAMPLES];
static q31_t reflection[MOST_STAGES], ladder[MOST_STAGES + 1], state[MOST_STAGES + BLOCK];

int main(int count, char **arguments)
{
    must(count == 3, "cmsis_dsp FOLDER SAMPLES");
    size_t length = strtoul(arguments[2], NULL, 10);
    size_t order = read_words(arguments[1], "lattice.i32", reflection, MOST_STAGES);
    must(length <= read_words(arguments[1], "noise-of-lattice.i32", noise, MOST_SAMPLES), "too many samples");
    ladder[order] = INT32_MAX;

    arm_iir_lattice_instance_q31 lattice;
    arm_iir_lattice_init_q31(&lattice, (uint16_t)order, reflection, ladder, state, BLOCK);
    double begin = processor_ns();
    for (size_t sample = 0; sample + BLOCK <= length; sample += BLOCK)
        arm_iir_lattice_q31(&lattice, noise + sample, samples + sample, BLOCK);
    finish(samples, length, processor_ns() - begin);
}

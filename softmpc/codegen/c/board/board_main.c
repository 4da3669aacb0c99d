/* Recorded steps on a board: steps.bin is read and answers.bin written by semihosting. */
#include "semihosting.h"
#include "startup.h"
#include "steps.h"

static int source, sink;

long smpc_read(void *buffer, unsigned long bytes)
{
    return (long)(bytes - smpc_file_read(source, buffer, bytes));
}

int smpc_write(const void *buffer, unsigned long bytes)
{
    return smpc_file_write(sink, buffer, bytes) ? -1 : 0;
}

unsigned long smpc_ticks(void)
{
    return smpc_cycles();
}

int main(void)
{
    smpc_tally tally;
    int failed;

    source = smpc_open("steps.bin", SMPC_READING);
    sink = smpc_open("answers.bin", SMPC_WRITING);
    if (source < 0 || sink < 0) {
        smpc_say("no steps.bin to read, or answers.bin cannot be written", 66);
        return 66;
    }
    failed = smpc_run_steps(&tally);
    if (smpc_close(sink)) failed = -1;
    smpc_say("steps", tally.steps);
    smpc_say("controller_bytes", sizeof(smpc_controller));
    smpc_say("stack_bytes", smpc_stack_used());
    smpc_say("prepare_ticks", tally.prepare);
    smpc_say("prepare_most_ticks", tally.prepare_most);
    smpc_say("feedback_ticks", tally.feedback);
    smpc_say("feedback_most_ticks", tally.feedback_most);
    return failed ? 1 : 0;
}

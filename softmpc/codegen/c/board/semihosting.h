/* Files and messages of a Cortex-M without a console, by way of the debugger or the emulator. */
#ifndef SMPC_SEMIHOSTING_H
#define SMPC_SEMIHOSTING_H

enum { SMPC_READING = 1, SMPC_WRITING = 5 }; /* modes "rb" and "wb" */

/* A handle, or -1. */
int smpc_open(const char *name, int mode);

/* How many of the bytes were not read, not written. */
unsigned long smpc_file_read(int handle, void *buffer, unsigned long bytes);
unsigned long smpc_file_write(int handle, const void *buffer, unsigned long bytes);
int smpc_close(int handle);

/* "name value" in a line on the console. */
void smpc_say(const char *name, unsigned long long value);

/* Ends the emulation with that exit code; does not return. */
void smpc_exit(int code);

#endif

/* Bytes of a flight log: records with their checksum, and the numbers in them. */
#ifndef SMPC_RECORDER_BYTES_H
#define SMPC_RECORDER_BYTES_H

#include "recorder.h"

/* Around the numbers of a record; `length` is how many bytes they are. */
void smpc_begin(smpc_recorder *r, int kind, size_t length);
void smpc_end(smpc_recorder *r);

void smpc_put(smpc_recorder *r, const unsigned char *bytes, size_t count);
void smpc_put_whole(smpc_recorder *r, uint64_t value, size_t count);
void smpc_put_double(smpc_recorder *r, double value);
void smpc_put_float(smpc_recorder *r, float value);
void smpc_put_reals(smpc_recorder *r, const smpc_real *values, size_t count);

/* At most 255 bytes, their number first. */
void smpc_put_text(smpc_recorder *r, const char *text);

#endif

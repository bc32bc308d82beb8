#ifdef TIMES
#define _POSIX_C_SOURCE 199309L
#include <time.h>
#endif
#include <math.h>
#include <stdio.h>
#include "$name.h"
#include "${name}_recording.h"

#define SAMPLES $samples
#ifndef ROUNDS
#define ROUNDS 100
#endif

static double found[$most];
$memory
$calls
static const struct {
    const char *name;
    void (*call)(int);
    const double *expected, *tolerance;
    int size;
} tests[] = {
$rows
};


#define TESTS ((int)(sizeof tests / sizeof tests[0]))

/* Largest error of the results at sample k, in units of its tolerance. */
static double error_of(int test, int k)
{
    const double *expected = tests[test].expected + k * tests[test].size;
    double largest = 0.0;
    int i;
    for (i = 0; i < tests[test].size; ++i) {
        double error = fabs(found[i] - expected[i]);
        double tolerance = tests[test].tolerance[i];
        if (!(error <= largest * tolerance)) {
            largest = tolerance > 0.0 ? error / tolerance : INFINITY;
        }
    }
    return largest;
}

#ifdef TIMES
static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

/* Least, mean and largest time of single calls, ns, reading the clock included; without the first
   sample, where a memory starts. */
static void print_times(int test)
{
    double sum = 0.0, least = INFINITY, largest = 0.0;
    int n, calls = ROUNDS * SAMPLES;
    for (n = 0; n < calls; ++n) {
        double start = now(), taken;
        tests[test].call(n % SAMPLES);
        taken = now() - start;
        if (n % SAMPLES == 0) {
            continue;
        }
        sum += taken;
        least = taken < least ? taken : least;
        largest = taken > largest ? taken : largest;
    }
    sum /= calls - ROUNDS;
    printf("%-20s %9.0f %9.0f %9.0f ns\n", tests[test].name, least, sum, largest);
}
#endif

int main(void)
{
    int failed = 0, test, k;
    for (test = 0; test < TESTS; ++test) {
        double largest = 0.0;
        for (k = 0; k < SAMPLES; ++k) {
            double error;
            tests[test].call(k);
            error = error_of(test, k);
            /* The comparison is false for NaN. */
            largest = error <= largest ? largest : error;
        }
        failed += !(largest <= 1.0);
        printf("%-20s %.2g of the tolerance\n", tests[test].name, largest);
    }
#ifdef TIMES
    for (test = 0; test < TESTS; ++test) {
        print_times(test);
    }
#endif
    printf(failed ? "failed\n" : "ok\n");
    return failed != 0;
}

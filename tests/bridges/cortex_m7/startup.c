/* Start of a program on the board MPS2 AN500 (Cortex-M7) of QEMU, and its clock. */
#include <time.h>

#define REGISTER(address) (*(volatile unsigned *)(address))
#define CPACR REGISTER(0xE000ED88u)
#define SYSTICK_CONTROL REGISTER(0xE000E010u)
#define SYSTICK_RELOAD REGISTER(0xE000E014u)
#define SYSTICK_VALUE REGISTER(0xE000E018u)
#define LARGEST 0xFFFFFFu
/* The processor's clock on this board, 25 MHz. */
#define NANOSECONDS 40

extern char __stack;
extern void _start(void);
void reset(void);

void reset(void)
{
    CPACR |= 0xFu << 20; /* enable the floating-point unit */
    __asm volatile("dsb\n isb");
    SYSTICK_RELOAD = LARGEST;
    SYSTICK_VALUE = 0;
    SYSTICK_CONTROL = 5; /* the processor's clock, no interrupt */
    _start();
}

__attribute__((section(".vectors"), used)) static const struct {
    char *stack;
    void (*reset)(void);
} vectors = {&__stack, reset};

/* With the option -icount shift=0 of QEMU, an instruction takes 1 ns. */
int clock_gettime(clockid_t which, struct timespec *t)
{
    static unsigned last = LARGEST;
    static long long sum;
    unsigned value = SYSTICK_VALUE;
    (void)which;
    sum += (long long)((last - value) & LARGEST) * NANOSECONDS;
    last = value;
    t->tv_sec = (time_t)(sum / 1000000000);
    t->tv_nsec = (long)(sum % 1000000000);
    return 0;
}

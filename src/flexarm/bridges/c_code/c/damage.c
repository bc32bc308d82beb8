#define TURNS $turns

/* Damage of one cycle. */
static double damage_of(double range)
{
    double ratio = range / $knee, cubed = ratio * ratio * ratio;
    if (range < $cut_off) {
        return 0.0;
    }
    return (ratio > 1.0 ? cubed : cubed * ratio * ratio) / 5e6;
}

static double distance(double a, double b)
{
    return a < b ? b - a : a - b;
}

/* Count the cycle between turning points i and i + 1 of n, and remove them; return the new n. */
static int closed(double *damage, double *turn, int i, int n)
{
    *damage += damage_of(distance(turn[i], turn[i + 1]));
    for (; i + 2 < n; ++i) {
        turn[i] = turn[i + 2];
    }
    return n - 2;
}

/* Add a stress to a point: memory[0] is its damage, memory[1] the number of its turning points,
   which follow; the last one moves until the stress turns by more than the cut-off limit, below
   which cycles do no damage. Before the first turn they are the least and the largest stress.
   A stress that is not finite is left out. */
static void add_stress(double stress, double *memory, int room)
{
    double *turn = memory + 2;
    int n = (int)memory[1], i, least = 1;
    if (!(stress - stress == 0.0)) {
        return;
    }
    if (n == 0) {
        turn[0] = turn[1] = stress;
        n = 1;
    } else if (n == 1) {
        turn[0] = stress < turn[0] ? stress : turn[0];
        turn[1] = stress > turn[1] ? stress : turn[1];
        if (turn[1] - turn[0] >= $cut_off) {
            n = 2;
            if (stress < turn[1]) {
                turn[0] = turn[1];
                turn[1] = stress;
            }
        }
    } else if ((stress < turn[n - 1]) == (turn[n - 1] < turn[n - 2])) {
        turn[n - 1] = stress;
    } else if (distance(stress, turn[n - 1]) >= $cut_off) {
        if (n == room) {
            for (i = 2; i + 2 < n; ++i) {
                least = distance(turn[i], turn[i + 1]) < distance(turn[least], turn[least + 1])
                            ? i : least;
            }
            n = closed(memory, turn, least, n);
        }
        turn[n++] = stress;
    }
    while (n >= 4 && distance(turn[n - 3], turn[n - 2]) <= distance(turn[n - 4], turn[n - 3])
           && distance(turn[n - 3], turn[n - 2]) <= distance(turn[n - 2], turn[n - 1])) {
        n = closed(memory, turn, n - 3, n);
    }
    memory[1] = n;
}

void ${name}_damage_update(
    const double stress[${NAME}_STRESSES],
    double damage_memory[${NAME}_DAMAGE_MEMORY])
{
    int k;
    for (k = 0; k < ${NAME}_STRESSES; ++k) {
        add_stress(stress[k], damage_memory + k * (2 + TURNS), TURNS);
    }
}

void ${name}_damage(
    const double damage_memory[${NAME}_DAMAGE_MEMORY],
    double damage[${NAME}_STRESSES])
{
    double repeated[2 + 2 * TURNS];
    int k, i;
    for (k = 0; k < ${NAME}_STRESSES; ++k) {
        const double *memory = damage_memory + k * (2 + TURNS);
        for (i = 0; i < 2 + TURNS; ++i) {
            repeated[i] = memory[i];
        }
        if (memory[1] >= 2.0) {
            for (i = 0; i < (int)memory[1]; ++i) {
                add_stress(memory[2 + i], repeated, 2 * TURNS);
            }
        }
        damage[k] = repeated[0];
    }
}

/* Fatigue damage at the points of ${name}_stress, for the detail category of $category Pa: at 1 the
 * life of a detail is used up. Rainflow cycles add their damage (Miner) by the curve of
 * EN 1993-1-9, 7.1: slope 3, from five million cycles on 5, none below the cut-off limit. The first
 * sample starts from a memory of zeros. The number of operations depends on the stress.
 *
 *   stress         of ${name}_stress, Pa; values that are not finite are left out
 *   damage_memory  damage of closed cycles, and up to $turns turning points of the stress at each
 *                  point. If more are open, the smallest range counts as a cycle.
 */
void ${name}_damage_update(
    const double stress[${NAME}_STRESSES],
    double damage_memory[${NAME}_DAMAGE_MEMORY]);

/* Damage since the start, with the cycles that are open as if the history repeated.
 *
 *   damage_memory  of ${name}_damage_update
 *   damage         damage at each point
 */
void ${name}_damage(
    const double damage_memory[${NAME}_DAMAGE_MEMORY],
    double damage[${NAME}_STRESSES]);

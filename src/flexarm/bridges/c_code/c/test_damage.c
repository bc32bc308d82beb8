static void call_damage(int k)
{
    int i;
    for (i = 0; k == 0 && i < (int)(sizeof damage_memory / sizeof damage_memory[0]); ++i) {
        damage_memory[i] = 0.0;
    }
    ${name}_damage_update(recorded_cycles[k], damage_memory);
    ${name}_damage(damage_memory, found);
}

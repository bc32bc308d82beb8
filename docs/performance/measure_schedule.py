"""Table of the page "Controllers compared": the gains of LQG along motions, and the optimum.

python docs/performance/measure_schedule.py [line | elbow]

The optimum has gains that change with time: the Riccati recursion, backwards along the motion, for
the linear model about the motion (`linearize_along`), with the weights of LQG (Bryson and Ho 1975).
"""

import sys

import numpy as np

import flexarm as fa

LEAD, TAIL = 0.5, 1.0  # s at rest before and after the motion


def arm_of():
    """Two slender links with encoders and gauges; 1 % of modal damping."""
    rod = {"mass_per_length": 0.61732, "damping": fa.ModalDamping(ratio=0.01)}
    rod |= {"flexural_rigidity": 105.0}
    rod |= {"gauges": [fa.Gauge(station=0.05, distance=0.005)]}
    return fa.Arm(
        links=[fa.Link(length=1.4142, elements=2, **rod), fa.Link(length=1.0, elements=1, **rod)],
        joints=[
            fa.Joint(hub_inertia=0.1),
            fa.Joint(mass=0.5, hub_inertia=0.02, housing_inertia=0.02),
        ],
    )


def cases(arm):
    """Return motions and the acceptable deviations of the design."""
    line = fa.line_motion(arm, (2.0, 1.0), (1.0, 2.0), 1.0, start_time=LEAD)
    elbow = fa.joint_motion(arm, [0.0, 0.3], [0.6, 2.4], 1.2, start_time=LEAD)
    usual = {"joint_angle": 0.01, "tip": 0.01, "joint_rate": 0.2}
    return {"line": (line, {"tip": 0.001, "joint_rate": 0.3}), "elbow": (elbow, usual)}


def angles_of(motion, times):
    """Return the angles (T, joints) at times (T,), which may be before or after the motion."""
    return motion.joint_angle(np.clip(times, motion.start_time, motion.end_time))


def designs(arm, motion, acceptable, **options):
    """Return LQG for one posture, and scheduled over the angles of the second joint."""
    start, end = motion.start_time, motion.end_time
    elbow = angles_of(motion, np.linspace(start, end, 201))[:, 1]
    grid = np.linspace(elbow.min(), elbow.max(), 5)
    middle = motion.joint_angle(0.5 * (start + end))
    return {
        "one posture": fa.LQG(arm, middle, acceptable=acceptable, **options),
        "schedule": fa.LQG(arm, middle, schedule=[None, grid], acceptable=acceptable, **options),
    }


class AlongMotion:
    """Linear model about a motion, sampled, and the weights of LQG at N samples.

    Attributes:
        A, B, known: x[k + 1] = A[k] x[k] + B[k] v[k] + known[k], with the state x, the torque v
            added to the rigid one, and the effect of the motion.
        Q, R: weights. tip, mass: of the model.
    """

    def __init__(self, arm, motion, acceptable, acceptable_torque, sample_time):
        from scipy.linalg import expm

        self.sample_time, self.joint_index = sample_time, arm.joint_index
        self.samples = round((motion.end_time + TAIL) / sample_time)
        middle = (np.arange(self.samples) + 0.5) * sample_time
        model = fa.linearize_along(
            arm, motion, times=np.clip(middle, motion.start_time, motion.end_time)
        )
        moving = (middle > motion.start_time) & (middle < motion.end_time)
        dof, n, m = arm.dof, *model.B.shape[1:]
        whole = np.zeros((self.samples, n + m + 1, n + m + 1))
        whole[:, :n, :n], whole[:, :n, n:-1] = model.A, model.B
        whole[moving, :n, -1] = model.f[moving]
        step = expm(sample_time * whole)
        self.A, self.B, self.known = step[:, :n, :n], step[:, :n, n:-1], step[:, :n, -1]
        self.mass, self.tip = model.deviation.M, model.deviation.tip
        self.R = np.diag(acceptable_torque**-2.0)
        C = np.zeros((self.samples, 6, n))
        C[:, [0, 1], arm.joint_index] = 1.0 / acceptable.get("joint_angle", np.inf)
        C[:, [2, 3], dof + arm.joint_index] = 1.0 / acceptable["joint_rate"]
        C[:, 4:, :dof] = self.tip / acceptable["tip"]
        self.Q = np.swapaxes(C, 1, 2) @ C

    def optimum(self):
        """Return the gains (N, m, n), feedforward (N, m) and costs (N + 1, n, n) of the optimum."""
        from scipy.linalg import solve, solve_discrete_are

        P = solve_discrete_are(self.A[-1], self.B[-1], self.Q[-1], self.R)
        s = np.zeros(len(P))
        gains, added, costs = [], [], [P]
        for A, B, Q, known in self._backwards(self.known):
            inner = self.R + B.T @ P @ B
            K = solve(inner, B.T @ P @ A, assume_a="pos")
            s = P @ known + s
            added.append(solve(inner, B.T @ s, assume_a="pos"))
            s = (A - B @ K).T @ s
            P = Q + A.T @ P @ (A - B @ K)
            P = (P + P.T) / 2.0
            gains.append(K)
            costs.append(P)
        return np.array(gains[::-1]), np.array(added[::-1]), np.array(costs[::-1])

    def costs_of(self, gains):
        """Return the costs (N + 1, n, n) of the feedback with gains (N, m, n)."""
        from scipy.linalg import solve_discrete_lyapunov

        K = gains[-1]
        loop = self.A[-1] - self.B[-1] @ K
        P = solve_discrete_lyapunov(loop.T, self.Q[-1] + K.T @ self.R @ K)
        costs = [P]
        for A, B, Q, K in self._backwards(gains):
            loop = A - B @ K
            P = Q + K.T @ self.R @ K + loop.T @ P @ loop
            costs.append(P)
        return np.array(costs[::-1])

    def _backwards(self, more):
        return zip(self.A[::-1], self.B[::-1], self.Q[::-1], more[::-1], strict=True)

    def impulses(self, k):
        """Return the states (n, 4) after unit impulses of the torques and of forces at the tip."""
        pushes = np.hstack([np.eye(len(self.mass[k]))[:, self.joint_index], self.tip[k].T])
        rates = np.linalg.solve(self.mass[k], pushes)
        return np.vstack([np.zeros_like(rates), rates])

    def run(self, torque):
        """Return the cost and the tip errors (N,), m, of a law: added torque at sample k, state."""
        x, cost, tip = np.zeros(self.A.shape[1]), 0.0, []
        for k in range(self.samples):
            v = torque(k, x)
            cost += x @ self.Q[k] @ x + v @ self.R @ v
            tip.append(np.linalg.norm(self.tip[k] @ x[: self.tip.shape[2]]))
            x = self.A[k] @ x + self.B[k] @ v + self.known[k]
        return cost, np.array(tip)


def laws_of(lqg, arm, motion, count):
    """Return the gains (N, m, n) of LQG along a motion, and its torques for known forces (N, m)."""
    times = np.arange(count + lqg._previewed) * lqg.sample_time
    clipped = np.clip(times, motion.start_time, motion.end_time)
    force = fa.linearize_along(arm, motion, times=clipped).deviation.r
    force = np.delete(force, arm.joint_index, axis=1)
    force[times > motion.end_time] = 0.0
    gains, added = [], []
    for k, angle in enumerate(motion.joint_angle(clipped[:count])):
        arrays = lqg._arrays.at(angle)
        gains.append(arrays[1].copy())
        known = force[k : k + lqg._previewed + 1 : lqg._stride]
        added.append(arrays[3][:, : known.size] @ known.ravel())
    return np.array(gains), np.array(added)


def excess(along, motion, gains, costs):
    """Return the largest relative excess of a cost after impulses at five times of the motion."""
    mine, found = along.costs_of(gains), []
    for t in np.linspace(motion.start_time, motion.end_time, 5):
        k = round(t / along.sample_time)
        x = along.impulses(k)
        own, least = (np.einsum("ij,ik,kj->j", x, P[k], x) for P in (mine, costs))
        found.append(float((own / least - 1.0).max()))
    return max(found)


def measure(name, sample_time=1e-3):
    """Return, for each law, both excess costs and the tip error in the motion (mm, rms)."""
    arm = arm_of()
    motion, acceptable = cases(arm)[name]
    made = designs(arm, motion, acceptable, sample_time=sample_time)
    torque = made["schedule"].design_requirements.acceptable_torque
    along = AlongMotion(arm, motion, acceptable, np.asarray(torque), sample_time)
    *best, costs = along.optimum()
    laws = {n: laws_of(lqg, arm, motion, along.samples) for n, lqg in made.items()}
    moving = slice(round(LEAD / sample_time), round(motion.end_time / sample_time) + 1)
    least, found = along.run(lambda k, x: -best[0][k] @ x - best[1][k])[0], {}
    for law, (gains, added) in {**laws, "optimum": best}.items():
        cost, tip = along.run(lambda k, x, K=gains, v=added: -K[k] @ x - v[k])
        rms = 1e3 * np.sqrt(np.mean(tip[moving] ** 2))
        found[law] = excess(along, motion, gains, costs), cost / least - 1.0, rms
    return found


def main():
    """Print the table as Markdown."""
    print("| motion | gains | cost after impulses | cost of the motion | tip, mm |")
    print("| --- | --- | --- | --- | --- |")
    for name in sys.argv[1:] or ("line", "elbow"):
        for law, (pushed, moved, tip) in measure(name).items():
            cells = f"{100.0 * pushed:.1f} % | {100.0 * moved:.1f} % | {tip:.2f}"
            print(f"| {name} | {law} | {cells} |", flush=True)


if __name__ == "__main__":
    main()

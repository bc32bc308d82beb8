"""Names of the columns of the kernels' arrays, with the symbol, unit and frame of each number.

Records of arrays and their shapes are in ``layout``. A name is an index along an axis: the mass
of body i is ``constants.body[i, MASS]``, the first moment of its mode j is
``constants.mode[i, j, S]``. A few arrays with named columns compile several times faster than one
array for each number, and are passed on faster; see decision 0016.

Axes of a body: origin at its joint, x along the tangent at its clamped root.
"""

from __future__ import annotations

# ``ArmConstants.arm`` (6,): constants of the whole arm.
ARM_COLUMNS = 6
(
    GRAVITY_X,  # m/s^2, world axes
    GRAVITY_Y,
    HAS_JOINT_LAWS,  # 1.0 if any joint has friction, stops or a geared rotor, else 0.0
    HAS_BRISTLES,  # 1.0 if states contain the deflection of bristles, else 0.0
    IS_FREE,  # 1.0 if only loads and contacts can change the momentum, else 0.0
    IS_TREE,  # 1.0 if any body is not on the tip of the one before, or slides, else 0.0
) = range(ARM_COLUMNS)

# ``ArmConstants.body`` (n, BODY_COLUMNS): constants of each body and of the joint at its root.
BODY_COLUMNS = 53
(
    MASS,  # kg
    INVERSE_MASS,  # 1/kg; 0 for a body without mass
    FIRST_MOMENT_X,  # kg m, int mu x dx
    FIRST_MOMENT_Y,  # kg m, of the undeformed body (a payload offset from the axis)
    INERTIA,  # kg m^2 about the joint, with section rotary inertia and hub
    HUB,  # kg m^2, part of INERTIA due to the hub
    INVERSE_INERTIA,  # 1/(kg m^2), of the link alone about its centre of mass, or 0
    LENGTH,  # m
    RESIDUAL_YY,  # kg, (m, mc, I) minus the part that the modes follow, (R.6)
    RESIDUAL_YW,  # kg m
    RESIDUAL_WW,  # kg m^2
    RESIDUAL_TIP_YY,  # 1, transfer T to the tip minus the part that the modes follow, (R.6)
    RESIDUAL_TIP_YW,  # m
    RESIDUAL_TIP_WY,  # 1/m
    RESIDUAL_TIP_WW,  # 1
    N_YY,  # 1/kg, P.P
    N_YW,  # 1/(kg m), P.dP
    N_WW,  # 1/(kg m^2), dP.dP
    TIP_MASS,  # kg, point mass at the body's tip
    TIP_INERTIA,  # kg m^2, rotating with the tip section
    FREE,  # 1.0 for a joint moved by forces, 0.0 for a fixed or prescribed one
    JOINT_ADDED,  # kg m^2, added to the joint's diagonal: in implicit steps, and if it sticks
    JOINT_DRAG,  # N m s/rad, slope of the friction torque: nonzero only in an implicit step
    JOINT_DAMPING,  # N m s/rad
    JOINT_STIFFNESS,  # N m/rad, spring parallel to the motor
    JOINT_REST,  # rad, rest angle of that spring
    JOINT_ANGLE,  # rad, added to the angle in the state: the angle of a fixed joint
    COULOMB,  # N m, dry friction
    STATIC_RISE,  # N m, static minus Coulomb friction
    STRIBECK_RATE,  # rad/s
    SMOOTHING_RATE,  # rad/s
    VISCOUS,  # N m s/rad
    COULOMB_EXCESS,  # N m, Coulomb friction at negative minus that at positive rates
    VISCOUS_EXCESS,  # N m s/rad, the same for viscous friction
    BRISTLED,  # 1.0 for dry friction by bristles, 0.0 for a function of the rate
    BRISTLE_ROOT,  # square root of the stiffness of the bristles in N m/rad
    BRISTLE_DAMPING,  # N m s/rad
    HOLDS,  # 1.0 for friction that holds a joint at rest in runs, else 0.0
    SLIDING,  # added to rate / SMOOTHING_RATE: not zero only in runs, while such a joint slides
    HELD_TORQUE,  # N m, torque that the friction of a sticking joint holds, in runs
    SLIP_TIME,  # s, first stage of the present step in which that torque is too large, in runs
    LOWER_STOP,  # rad
    UPPER_STOP,  # rad
    STOP_STIFFNESS,  # N m/rad
    STOP_DAMPING,  # s/rad
    ROTOR_INERTIA,  # kg m^2 of the motor's rotor, about its own axis
    GEAR_RATIO,  # of that rotor
    PARENT,  # index of the body whose tip section carries the joint, -1.0: the ground
    SLIDES,  # 1.0 for a joint that slides, 0.0 for one that turns
    SLIDE_X,  # direction of a sliding joint, axes of the body; 0 for one that turns
    SLIDE_Y,
    PLACE_X,  # m, of the joint (a sliding one at zero) from the tip, axes of the tip section
    PLACE_Y,
) = range(BODY_COLUMNS)

# ``ArmConstants.mode`` (n, m, MODE_COLUMNS): constants of each mode; eta in m sqrt(kg).
MODE_COLUMNS = 7
(
    S,  # sqrt(kg), int mu Phi dx
    A,  # m sqrt(kg), int mu x Phi dx + int rho I Phi' dx
    P,  # 1/sqrt(kg), Phi(L)
    DP,  # 1/(m sqrt(kg)), Phi'(L)
    W2,  # rad^2/s^2, squared frequency
    MODE_DAMPING,  # 1/s
    MODE_MOBILITY,  # acceleration per modal force: 1, or 1 / Delta in an implicit step
) = range(MODE_COLUMNS)

# ``ArmConstants.shortening`` (n, g, g, SHORTENING_COLUMNS): constants of each pair of modes.
SHORTENING_COLUMNS = 3
(
    D0,  # 1/m, int mu g(x) dx
    D1,  # 1, int mu x g(x) dx
    G,  # 1/(kg m), g(L)
) = range(SHORTENING_COLUMNS)

# ``Workspace.body`` (n, WORK_BODY_COLUMNS): results for each body, in its axes except WORLD_*.
WORK_BODY_COLUMNS = 97
(
    COSINE,  # of the rotation from the previous body's axes to these
    SINE,
    RATE,  # w, angular rate of the body axes, rad/s
    TIP_X,  # L + u_L, m
    TIP_Y,  # v_L, m
    TIP_BIAS_X,  # velocity products in the tip's acceleration, m/s^2
    TIP_BIAS_Y,
    MOMENT_S,  # s, kg m
    MOMENT_MU,  # mu, kg m
    BENT_INERTIA,  # kg m^2, added to the inertia by bending
    BENT_RESIDUAL,  # kg m^2, residual part of BENT_INERTIA
    ROOT_BIAS_X,  # velocity products in the root wrench, N
    ROOT_BIAS_Y,
    ROOT_BIAS_W,  # N m
    ALPHA,  # m, of (L.44)
    BETA,  # of (L.44)
    MEAN_RATES,  # rates of (R.46); then terms of (R.45)
    MEAN_LEFT,
    MEAN_LAG,
    MEAN_Y,
    MEAN_W,
    MEAN_FX,
    TRANSFER_XX,  # residual transfer from root to tip, in the order of ``recursion.symmetric``
    TRANSFER_XY,
    TRANSFER_XW,
    TRANSFER_YX,
    TRANSFER_YY,
    TRANSFER_YW,
    TRANSFER_WX,
    TRANSFER_WY,
    TRANSFER_WW,
    BENT_N_XX,  # N of the second-order theory, in the order of ``recursion.symmetric``
    BENT_N_XY,
    BENT_N_YY,
    BENT_N_XW,
    BENT_N_YW,
    BENT_N_WW,
    DRIFT_X,  # tip acceleration at zero root acceleration and zero tip force
    DRIFT_Y,
    DRIFT_W,
    GAIN_XX,  # tip force per root acceleration
    GAIN_XY,
    GAIN_XW,
    GAIN_YX,
    GAIN_YY,
    GAIN_YW,
    GAIN_WX,
    GAIN_WY,
    GAIN_WW,
    GAIN_XK,  # tip force at zero root acceleration
    GAIN_YK,
    GAIN_WK,
    JOINT_UX,  # U: coefficients of the root acceleration in the joint's equation
    JOINT_UY,
    JOINT_UW,
    JOINT_INERTIA,  # that the joint moves, kg m^2; kg for one that slides
    JOINT_INVERSE,  # free / D
    JOINT_DRIVE,  # tau - h_w, N m
    JOINT_GIVEN,  # prescribed acceleration, rad/s^2
    ROOT_ACCELERATION_X,  # of the joint minus gravity (inverse dynamics), m/s^2
    ROOT_ACCELERATION_Y,
    ROOT_ACCELERATION_W,  # rad/s^2
    TIP_ACCELERATION_X,  # of the tip minus gravity
    TIP_ACCELERATION_Y,
    TIP_ACCELERATION_W,
    WRENCH_X,  # of the joint on its body, N
    WRENCH_Y,
    WRENCH_W,  # N m
    WORLD_COSINE,  # of the absolute angle of the body axes (with loads)
    WORLD_SINE,
    WORLD_X,  # of the body's root (with contacts), world axes, m
    WORLD_Y,
    WORLD_X_RATE,  # m/s
    WORLD_Y_RATE,
    STOPS_FIXED,  # 1.0 while an integrator fixes whether the stops push, 0.0: the angle decides
    LOWER_PUSHES,  # 1.0 or 0.0, if fixed
    UPPER_PUSHES,
    TIP_SLOPE,  # phi, rad (the columns from here on in trees only)
    TIP_RATE,  # w + phi_dot, rad/s
    ROOT_FROM_X,  # of the root from the section that carries it, m
    ROOT_FROM_Y,
    JOINT_BIAS_X,  # velocity products in the acceleration of the root, m/s^2
    JOINT_BIAS_Y,
    CARRIED_XX,  # inertia of the bodies on the tip, in the order of ``recursion.symmetric``;
    # after a body is eliminated, its Y
    CARRIED_XY,
    CARRIED_YY,
    CARRIED_XW,
    CARRIED_YW,
    CARRIED_WW,
    CARRIED_KX,  # their wrench on the tip without acceleration, N
    CARRIED_KY,
    CARRIED_KW,  # N m
    WORLD_TIP_X,  # of the tip section, world axes, m
    WORLD_TIP_Y,
    WORLD_TIP_ANGLE,  # rad
    WORLD_TIP_X_RATE,  # m/s
    WORLD_TIP_Y_RATE,
) = range(WORK_BODY_COLUMNS)

# ``Workspace.mode`` (n, m, WORK_MODE_COLUMNS): results for each mode; the last three are used by
# the second-order theory only.
WORK_MODE_COLUMNS = 4
(
    FLEX_BIAS,  # stiffness, damping and velocity products of the modal equations
    D0_ETA,  # D0 eta
    D1_ETA,  # D1 eta
    FX,  # first row of F: -G eta
) = range(WORK_MODE_COLUMNS)

# ``ArmConstants.closure`` (r, CLOSURE_COLUMNS): constants of each row of closures.
CLOSURE_COLUMNS = 12
(
    FIRST_X,  # m, of the first point from the axis of its section, axes of the section
    FIRST_Y,
    SECOND_X,  # m, of the second point; on the ground, world axes
    SECOND_Y,
    CLOSURE_ANGLE,  # rad, between the sections, or of the line or curve from the second section
    CURVE_CURVATURE,  # of a curve from here on, in the order of ``forces.surface``: 1/m
    CURVE_X,  # m, of a point on it, in its axes
    CURVE_Y,
    CURVE_NORMAL_X,
    CURVE_NORMAL_Y,
    CURVE_FIRST,  # first row of its table in ``ArmConstants.knots``
    CURVE_COUNT,  # number of these rows, 0 without a table
) = range(CLOSURE_COLUMNS)

# ``Workspace.closure`` (r, CLOSURE_WORK_COLUMNS): results for each row.
CLOSURE_WORK_COLUMNS = 11
(
    GAP,  # g, m or rad
    GAP_RATE,
    EXTRA,  # terms of its second derivative without accelerations
    RELATIVE,  # its second derivative without closure forces
    MULTIPLIER,  # lambda, N or N m
    FIRST_WRENCH_X,  # on the section of the first point at a multiplier of one, world axes
    FIRST_WRENCH_Y,
    FIRST_WRENCH_W,
    SECOND_WRENCH_X,  # the same for the second point
    SECOND_WRENCH_Y,
    SECOND_WRENCH_W,
) = range(CLOSURE_WORK_COLUMNS)

# ``Workspace.column`` (r, n, COLUMN_COLUMNS): each row as a bias of each body, axes of the body.
COLUMN_COLUMNS = 7
(
    BIAS_KX,  # k at the tip
    BIAS_KY,
    BIAS_KW,
    PASSED_X,  # m, behind the modes
    PASSED_Y,
    PASSED_W,
    PASSED_DRIVE,  # on the joint
) = range(COLUMN_COLUMNS)

"""Which numbers of the benchmarks the performance page shows, and under which words."""

SEGMENTS = (1, 2, 4, 8)
# What a user waits for: (what, benchmark, number).
CALLS = (
    ("residual of the model, compiled", "compiling", "1_segment_residual_compiled_us"),
    ("residual, CasADi's virtual machine", "compiling", "1_segment_residual_us"),
    ("its Jacobian, compiled", "compiling", "1_segment_residual_jacobian_compiled_us"),
    ("its Jacobian, CasADi's virtual machine", "compiling", "1_segment_residual_jacobian_us"),
    ("one implicit step of a simulation", "simulating", "1_segments_implicit_step_us"),
    ("controller step in C", "c_controller", "unsaturated_softmpc_in_c_step_cpu_ms_median"),
    (
        "controller step in Python, real-time iteration",
        "controllers",
        "rti_free_step_cpu_ms_median",
    ),
    ("controller step, SQP to convergence", "controllers", "sqp_free_step_cpu_ms_median"),
    ("controller step, IPOPT", "controllers", "ipopt_free_not_compiled_step_cpu_ms_median"),
    ("one estimate in Python", "pilot", "python_estimate_ms"),
    ("one estimate in C", "pilot", "c_double_estimate_ms"),
    ("1 s of motion of the plant in C", "c_plant", "figure_eight_cpu_ms_a_second"),
    ("inverse statics of a target, cold", "inverse", "1_segment_no_load_cold_ms_median"),
    ("inverse statics of a target, warm", "inverse", "1_segment_no_load_warm_ms_median"),
    ("an arm at rest in a calibration", "calibrating", "a_rest_alone_ms"),
    ("2 s of motion in a calibration", "calibrating", "2_s_of_motion_alone_ms"),
    ("`import softmpc`", "startup", "import_softmpc_s"),
    ("`softmpc --help`", "startup", "softmpc_help_s"),
    ("workspace on a coarse grid", "workspace", "two_sections_cpu_s"),
    ("compiling the residual, once", "compiling", "1_segment_residual_compile_s"),
    ("compiling its Jacobian, once", "compiling", "1_segment_residual_jacobian_compile_s"),
    ("a controller in Python, from a cold start", "controllers", "rti_cold_start_cpu_s"),
    ("planning a motion around obstacles", "plans", "planning_s_median"),
    ("compiling a controller in C", "fuzz_controller", "controller_compile_cpu_s"),
    ("a simulation from the command line", "simulating", "start_to_result_compiled_before_s"),
)
RTI = "softmpc_rti_compiled_time_ratio_do_mpc_our_step_tuned_to_ours"
# (what, peer, benchmark, number): times of the peer over ours.
PEERS = (
    ("10 s of motion, one step", "soromox", "peer",
     "one_step_pressures_motion_time_ratio_soromox_to_ours"),
    ("10 s of motion, a step a second", "soromox", "peer",
     "a_step_a_second_pressures_motion_time_ratio_soromox_to_ours"),
    ("the first, from the start of Python", "soromox", "peer",
     "one_step_pressures_start_to_result_time_ratio_soromox_to_ours"),
    ("controller step, real-time iteration", "do-mpc, tuned", "peer_mpc", RTI),
    ("controller step, SQP to convergence", "do-mpc, tuned", "peer_mpc",
     RTI.replace("rti", "sqp", 1)),
    ("controller step in C", "do-mpc, tuned", "c_controller",
     "unsaturated_do_mpc_our_step_tuned_time_ratio_to_ours"),
    ("controller step in C", "acados, GNSF", "c_controller",
     "unsaturated_acados_gnsf_time_ratio_to_ours"),
    ("controller step in C", "our IPOPT", "c_controller",
     "unsaturated_softmpc_ipopt_time_ratio_to_ours"),
    ("controller step in C", "our Python", "c_controller",
     "unsaturated_softmpc_python_rti_time_ratio_to_ours"),
)  # fmt: skip
COUNTED = {
    "residual": "residual",
    "derivative along one direction": "residual_along",
    "Jacobian": "jacobian",
    "Jacobian by automatic differentiation": "jacobian_by_ad",
    "M, C, N, τ": "equations",
}
SOLVERS = {
    "IPOPT, not compiled": "ipopt {} not_compiled",
    "real-time iteration, not compiled": "rti {} not_compiled",
    "SQP": "sqp {}",
    "real-time iteration": "rti {}",
}
# Time in place of that of the plain case: (what, benchmark, number).
FACTORS = (
    ("simulation step without hydraulics", "simulating",
     "step_time_ratio_no_hydraulics_static_drive"),
    ("simulation step of a planar arm", "simulating", "step_time_ratio_planar"),
    ("simulation step without inertia", "simulating", "step_time_ratio_quasi_static"),
    ("simulation step with coupled chambers", "simulating",
     "step_time_ratio_with_chamber_coupling"),
    ("residual in the virtual machine, of compiled", "compiling", "1_segment_residual_time_ratio"),
    ("Jacobian in the virtual machine, of compiled", "compiling",
     "1_segment_residual_jacobian_time_ratio"),
    ("IPOPT's iteration with exact Hessian, of Gauss-Newton", "hessians",
     "iteration_time_ratio_exact_to_gauss_newton"),
    ("estimate, of a controller step", "estimation", "estimate_to_controller_time_ratio"),
)  # fmt: skip
MOTIONS = ("step_fig12", "ramp_fig8", "ramp_fig14")
PARTS = ("linearise", "condense", "qp", "measure")
# (what, benchmark, number, unit or "of" and the number of all): how good the answers were.
QUALITY = (
    ("tip error of a simulation, step of Fig. 12", "simulating", "step_fig12_1_segments_error_mm",
     "mm"),
    ("tracking a figure eight, RMS", "tracking", "eight_rms_mm", "mm"),
    ("tracking a circle of 1.5 s a lap, RMS", "tracking", "fast_rms_mm", "mm"),
    ("the same with a plant that is not the model, figure eight", "mismatch",
     "stiffer_finer_loaded_rms_mm", "mm"),
    ("cost of real-time iteration over SQP, torque at its limit", "controllers",
     "rti_saturated_cost_over_sqp", ""),
    ("starts that come to rest with 5 intervals", "stability", "5_intervals_at_rest_count",
     "of starts_count"),
    ("targets in reach that inverse statics solves", "inverse",
     "1_segment_no_load_cold_solved_count", "of 1_segment_no_load_cold_of_count"),
    ("runs with random faults not back in time", "faults", "runs_not_back_within_2_s_count",
     "of runs_count"),
    ("plans that hold in a replay", "plans", "good_count", "of problems_count"),
    ("difference of C and Python, inputs", "c_controller", "input_off_python_nm", "N·m"),
    ("random inputs for a controller in C: programs that found a fault", "fuzz_controller",
     "workers_that_failed_count", ""),
)  # fmt: skip
# Where the details are.
DETAILS = {
    "instructions": "model", "looping": "model", "compiling": "compiled", "startup": "architecture",
    "inverse": "inverse", "workspace": "workspace", "simulating": "simulation",
    "peer": "simulation",
    "calibrating": "calibration", "coverage": "calibration", "controllers": "solvers",
    "hessians": "mpc", "peer_mpc": "solvers", "tracking": "controller", "speeds": "controller",
    "cheaper": "controller", "stability": "controller", "estimation": "estimation",
    "mismatch": "rig", "faults": "rig", "plans": "planning", "plan_tracking": "mpc",
    "c_controller": "codegen", "c_plant": "codegen", "pilot": "codegen",
    "fuzz_controller": "codegen", "choosing": "accuracy",
}  # fmt: skip
TEXT = """\
# Performance

What is fast, what is not, and beside what. One command in a checkout runs the benchmarks of all
parts, each in a process of its own with one BLAS thread:

```bash
python -m tests.benchmarks --quick --store
python docs/make_performance.py
```

The second writes this page from the stored run; every number that was measured is one of it.

{machine}

Quick runs are short, and so are their paths, seeds and repeats: pages with details say what
longer ones gave. Times are medians. On a machine that does other work, medians of the same
program differ, so the command tells of a time only where it changed by more than a factor of
{band}; ratios within a run are better, and counts of instructions are exact.

## What one waits for

The paper's arm, two sections of one segment with their hydraulics unless it says otherwise, the
quickest first. A controller of 40 steps a second has 25 ms.

{calls}

## Beside others

On the same problem, in the same run. Above 1, ours is quicker. The pages say what is alike and
what is not.

{peers}

soromox and do-mpc are optional (`pip install soromox do-mpc`); acados gets an environment of its
own, made on the first run. A dash stands for what this run does not have; the last table says why.

## Simulation

Three motions of the paper, at most 1 µm of error asked for at the tip a step. Times real time, and
the error of the tip from another method at a tight tolerance.

{motions}

## Size of the model

Instructions that one call executes in CasADi's virtual machine, by segments a section (with
rotary inertia, in air). They are the same on every machine with this CasADi, and the command ends
with status 3 where one grew.

{instructions}

## A controller step

25 ms, 20 intervals, 34 states. "Saturated" is the same circle with the torque limited to less
than it asks for. Whole steps, Python included.

{steps}

## Where the time goes

In C, of a step on a path within the limits (the mean of the first steps, by Valgrind):

{parts}

What other choices cost, as a factor of the plain case:

{factors}

Compiling pays where a function is called often ([](compiled.md)); derivatives by recursion are
what keeps long arms usable ([](model.md#derivatives)). What is slow is slow once: building and
compiling a controller, planning, a workspace.

## How good the answers were

Speed without an error means nothing, so here are some of the same run:

{quality}

## The benchmarks

`python -m tests.benchmarks NAME …` runs some of them, `python -m tests.benchmarks.NAME` prints
the table of one, with options of its own (`--help`). `--full` takes hours and does what the pages
quote; `--resume` goes on with a run that was interrupted; `--compare FILE` compares with another
stored run than the last. The exit status is 3 where a benchmark failed or a count of instructions
grew. A benchmark is a module of `tests/benchmarks` with a function `numbers(quick)` that gives
what it measured as plain numbers; it is listed in `listing.py`.

{overview}
"""

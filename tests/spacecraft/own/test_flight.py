"""Flights of spacecraft from files of their own, by `mj_step`: against closed forms, conservation laws and the packaged one."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from scipy.optimize import least_squares

from swarm_mj.flight.fly import make_simulation, simulate
from swarm_mj.flight.plan import make_plan
from swarm_mj.flight.spacecraft import notes_on
from swarm_mj.io.resources import asset_path
from swarm_mj.scenarios.loading import load_scenario, parse_overrides
from swarm_mj.simulator.slots import Slot
from swarm_mj.smallbody.perturbations import gravity_gradient_torque
from swarm_mj.spacecraft.attitude.mrp import dcm
from swarm_mj.spacecraft.elastic import largest_timestep, lost_to_the_step, modes_of
from swarm_mj.spacecraft.own_spacecraft import small_motions

from .files import MOTOR, ORTHOGONAL, SPIN, mjcf


class NoTorque:
    """A control law that leaves the wheels alone."""

    def torque(self, inputs, memory):
        return np.zeros_like(inputs.sigma_BR), memory


def plan_of(folder, text, *overrides, still=True, points="[12]"):
    """A plan with a file of its own; still: without initial rates and without control."""
    path = folder / "own.xml"
    path.write_text(text)
    quiet = ["spacecraft.initial_rate_range_rpm=0"] if still else []
    given = [f"spacecraft.mjcf={path}", f"design.visiting_points={points}", *quiet, *overrides]
    plan = make_plan(load_scenario("eros-quick", parse_overrides(given)))
    return replace(plan, controller=NoTorque()) if still else plan


def flown(plan, seconds, interval):
    """The record of a flight and its simulation."""
    simulation = make_simulation(plan)
    record = simulation.run(seconds, interval)
    variables = record.instruments.variables(set())
    return record.time, {name: values for name, (_, values, _) in variables.items()}, simulation


def fitted(times, angle):
    """Angular frequency [rad/s] and decay rate [1/s] of a damped oscillation, with nothing known beforehand."""
    spectrum = np.abs(np.fft.rfft(angle - angle.mean()))
    omega = 2 * np.pi * np.fft.rfftfreq(len(times), times[1] - times[0])[np.argmax(spectrum)]

    def residual(p):
        return np.exp(-p[1] * times) * (p[2] * np.cos(p[0] * times) + p[3] * np.sin(p[0] * times)) + p[4] - angle

    found = least_squares(
        residual, [omega, 0.0, angle[0], 0.0, 0.0], x_scale=[0.01, 0.01, 1e-3, 1e-3, 1e-4], xtol=1e-14
    )
    assert np.abs(found.fun).max() < 0.02 * np.abs(angle).max()
    return found.x[:2]


PANEL_MASS, HINGE, REACH, STIFFNESS = 0.5, 0.05, 0.2, 0.05
_PANEL = (
    f'<body name="panel" pos="{HINGE} 0 0"><joint name="fold" axis="0 1 0" stiffness="{{k}}" damping="{{damping}}"/>'
    f'<inertial pos="{REACH} 0 0" mass="{PANEL_MASS}" diaginertia="0.0017 0.0037 0.0054"/></body>'
)


def panel(damping, stiffness=STIFFNESS):
    """A panel on a hinge about the y axis."""
    return _PANEL.format(damping=damping, k=stiffness)


BENT = '<keyframe><key name="start" qpos="0 0 0 1 0 0 0 0 0 0 0.01"/></keyframe>'


def panel_frequency(damping):
    """Angular frequency [rad/s] and decay rate [1/s] of the panel's small motion on the free hub.

    Hub (mass m, inertia I about the y axis) and panel (M, J) move in the plane across the hinge: theta turns the hub, phi the
    panel against it. The hinge is a off the hub's centre of mass, the panel's centre of mass b off the hinge, in one line. The
    centre of mass of both stays where it is, so that translation leaves the reduced mass mu = m M / (m + M) times the square
    of the relative velocity of their centres, which is (a theta' + b (theta' + phi')) across that line for small phi:

        2 T = I theta'^2 + J (theta' + phi')^2 + mu (a theta' + b (theta' + phi'))^2,   2 V = k phi^2.

    The wheel about the same axis turns freely on its own and takes no part: I is without its spin inertia. Nothing turns the
    whole: d/dt (dT / dtheta') = 0 gives theta' = -(M12 / M11) phi', and

        (M22 - M12^2 / M11) phi'' + c phi' + k phi = 0,
        M11 = I + J + mu (a + b)^2,   M12 = J + mu b (a + b),   M22 = J + mu b^2.
    """
    hub_mass, hub = 8.0, 8.0 / 12.0 * (0.1**2 + 0.34**2) - SPIN
    mu, panel = hub_mass * PANEL_MASS / (hub_mass + PANEL_MASS), 0.0037
    both, mixed, own = (
        hub + panel + mu * (HINGE + REACH) ** 2,
        panel + mu * REACH * (HINGE + REACH),
        panel + mu * REACH**2,
    )
    inertia = own - mixed**2 / both
    decay = damping / (2 * inertia)
    return np.sqrt(STIFFNESS / inertia - decay**2), decay


@pytest.mark.parametrize("damping", [0.0, 1.5e-3])
def test_a_panel_on_a_spring_swings_with_the_coupled_frequency_and_decays_as_its_damper_says(tmp_path, damping):
    plan = plan_of(tmp_path, mjcf(panel(damping), rest=BENT), "physics.timestep_s=0.1")
    times, seen, _ = flown(plan, 60.0, 0.5)
    omega, decay = fitted(times, seen["joint_fold_position"][:, 0])
    expected, expected_decay = panel_frequency(damping)
    assert omega == pytest.approx(expected, rel=1e-4)
    assert decay == pytest.approx(expected_decay, rel=1e-3, abs=2e-5)
    # The linearised model that chooses timesteps knows the same.
    model = mujoco.MjModel.from_xml_path(str(plan.own.path))
    (mode,) = modes_of(model, np.array(plan.own.start_qpos), ["fold"])
    assert abs(mode.eigenvalue.imag) == pytest.approx(expected, rel=1e-4)
    assert -mode.eigenvalue.real == pytest.approx(expected_decay, rel=1e-4, abs=1e-12)
    assert abs(decay - expected_decay) < 3 * abs(lost_to_the_step(mode, 0.1, 1.0)) + 1e-3 * expected_decay


def test_a_sloshing_mass_swings_with_the_reduced_mass(tmp_path):
    """Two masses m and M on a spring k along the line through both centres: omega^2 = k (1/m + 1/M), at any amplitude."""
    tank = (
        '<body name="fuel"><joint name="slosh" type="slide" axis="0 0 1" stiffness="0.8"/>'
        '<inertial pos="0 0 0" mass="2" diaginertia="1e-3 1e-3 1e-3"/></body>'
    )
    start = '<keyframe><key name="start" qpos="0 0 0 1 0 0 0 0 0 0 0.02"/></keyframe>'
    times, seen, _ = flown(plan_of(tmp_path, mjcf(tank, rest=start), "physics.timestep_s=0.1"), 60.0, 0.5)
    omega, decay = fitted(times, seen["joint_slosh_position"][:, 0])
    assert omega == pytest.approx(np.sqrt(0.8 * (1 / 8.0 + 1 / 2.0)), rel=1e-4)
    assert abs(decay) < 1e-5


LOOSE = (
    '<body name="loose" pos="0.3 0 0"><joint name="x" type="slide" axis="1 0 0"/><joint name="y" type="slide" axis="0 1 0"/>'
    '<joint name="z" type="slide" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1e-3 1e-3 1e-3"/></body>'
)


def test_every_body_has_its_weight_so_that_free_fall_moves_no_joint(tmp_path):
    # Without a weight of its own the loose mass would stay behind by half g t^2, which is 40 m in 300 s.
    plan = plan_of(tmp_path, mjcf(LOOSE))
    times, seen, simulation = flown(plan, 300.0, 10.0)
    pull = np.linalg.norm(plan.environment.acceleration_N(0.0, simulation.state.work[Slot.R]))
    assert 0.5 * pull * 300.0**2 > 20.0
    for axis in "xyz":
        assert np.abs(seen[f"joint_{axis}_position"]).max() < 1e-7  # rounding, thirty kilometres from the origin


def test_the_centre_of_mass_flies_as_a_point_does(tmp_path):
    alone = simulate(make_plan(load_scenario("eros-quick", {"duration_s": 600})))
    plan = plan_of(tmp_path, mjcf(panel(1e-3), rest=BENT), still=False, points="[12, 40]")
    times, seen, simulation = flown(plan, 600.0, 5.0)
    assert np.array_equal(times, alone["time"].values)
    # To what holding the force at the middle of a hold costs, at places that differ by the wobble of the hub.
    assert np.abs(seen["r_CN_N"] - alone["r_BN_N"].values).max() < 1e-5
    r_BN_N = simulation.state.r_N
    assert 0.005 < np.linalg.norm(seen["r_CN_N"][-1] - r_BN_N, axis=1).max() < 0.02


def test_the_momentum_of_hub_panel_and_wheels_together_stays_whatever_the_control_does(tmp_path):
    plan = plan_of(tmp_path, mjcf(panel(1e-3), rest=BENT), "physics.timestep_s=0.1", still=False)
    simulation, momenta, turned = make_simulation(plan), [], []
    model, data = simulation.model.mjmodel, simulation.data
    for _ in range(120):
        simulation.model.centres_of_mass(data)
        momenta.append(data.subtree_angmom[simulation.model.hub_body[0]].copy())
        turned.append(simulation.state.wheel_speed[0].copy())
        simulation.fly(1)
    moved = SPIN * np.abs(turned).max()
    assert moved > 1e-3  # kg m^2/s: the wheels have taken up a tumble
    assert np.abs(np.diff(momenta, axis=0)).max() < 1e-7 * moved
    assert np.abs(momenta - momenta[0]).max() < 1e-6 * moved
    assert model.nv == 10


def test_the_accelerometer_feels_the_flown_motion_less_gravity(tmp_path):
    """Second differences of the site's place, less the field: r_SN = r_BN + C_NB s, to fourth order in the interval."""
    site = np.array([0.04, -0.03, 0.12])
    on_hub = f'<site name="corner" pos="{site[0]} {site[1]} {site[2]}" quat="0.5 0.5 0.5 0.5"/>' + panel(1e-3)
    plan = plan_of(
        tmp_path,
        mjcf(on_hub, sensors='<accelerometer name="felt" site="corner"/>', rest=BENT),
        "physics.timestep_s=0.1",
        "control.period_s=0.1",
        "telemetry.interval_s=0.1",
        "spacecraft.initial_rate_range_rpm=0.5",
        "perturbations={solar_tide: true, solar_radiation_pressure: true}",
        "duration_s=600",
    )
    simulation = make_simulation(plan)
    record = simulation.run(20.0, 0.1)
    _, felt, attributes = record.instruments.variables(set())["felt"]
    assert attributes["units"] == "m s-2" and attributes["frame"] == "site corner"
    C_BN = dcm_of(record.samples["q_BN"][:, 0])
    r_N = record.samples["r_BN_N"][:, 0] + np.einsum("tij,i->tj", C_BN, site)
    step = 0.1
    a_N = (-r_N[4:] + 16 * r_N[3:-1] - 30 * r_N[2:-2] + 16 * r_N[1:-3] - r_N[:-4]) / (12 * step**2)
    environment = plan.environment
    push = np.array([environment.pressure_acceleration_N(t, r[None])[0] for t, r in zip(record.time, r_N, strict=True)])
    field = np.array([environment.acceleration_N(t, r[None])[0] for t, r in zip(record.time, r_N, strict=True)]) - push
    C_SB = np.array([[0, 1, 0], [0, 0, 1], [1, 0, 0]])  # of the quaternion (1, 1, 1, 1) / 2
    expected = np.einsum("ij,tjk,tk->ti", C_SB, C_BN[2:-2], a_N - field[2:-2])
    scale = np.abs(expected).max()
    assert scale > 1e-3 and np.abs(field).max() > 0.3 * scale  # both matter
    assert np.abs(felt[2:-2, 0] - expected).max() < 2e-3 * scale


def dcm_of(q):
    from swarm_mj.spacecraft.attitude.mrp import mrp_from_quaternion

    return dcm(mrp_from_quaternion(q))


def test_an_accelerometer_in_free_fall_feels_nothing_but_radiation_pressure(tmp_path):
    text = mjcf(sensors='<accelerometer name="felt" site="imu"/>')
    for pressed in (False, True):
        plan = plan_of(tmp_path, text, f"perturbations.solar_radiation_pressure={str(pressed).lower()}")
        _, seen, simulation = flown(plan, 10.0, 5.0)
        size = np.linalg.norm(seen["felt"], axis=-1)
        push = np.linalg.norm(plan.environment.pressure_acceleration_N(0.0, simulation.state.work[Slot.R]))
        assert np.allclose(size, push, rtol=1e-3, atol=1e-12) and bool(push > 1e-9) is pressed


def test_the_packaged_spacecraft_flies_from_its_file_as_it_does_without(tmp_path):
    # The same bodies by two ways: forces and torques at each body, or at the hub.
    forces = "perturbations={solar_tide: true, solar_radiation_pressure: true, gravity_gradient_torque: true}"
    packaged = simulate(make_plan(load_scenario("eros-quick", parse_overrides([forces, "duration_s=600"]))))
    text = asset_path("mjcf/cubesat.xml").read_text("utf-8")
    path = tmp_path / "cubesat.xml"
    path.write_text(text)
    own = simulate(
        make_plan(load_scenario("eros-quick", parse_overrides([forces, "duration_s=600", f"spacecraft.mjcf={path}"])))
    )
    assert (packaged.attrs["stepper"], own.attrs["stepper"]) == ("mujoco", "mujoco")
    for name, largest in {"r_BN_N": 1e-7, "sigma_BN": 1e-7, "omega_BN_B": 1e-7, "wheel_speed": 1e-3}.items():
        assert np.abs(packaged[name].values - own[name].values).max() < largest, name
    # Its own sensors read what the telemetry says.
    assert np.allclose(own["rates"], own["omega_BN_B"], atol=1e-15)
    assert np.allclose(own["wheel_x_speed"], own["wheel_speed"][..., 0], atol=1e-12)
    assert own["attitude"].dims == ("time", "spacecraft", "wxyz")


def test_the_tide_across_the_bodies_is_the_gravity_gradient_torque_of_the_whole(tmp_path):
    plan = plan_of(tmp_path, mjcf(panel(0)), "perturbations.gravity_gradient_torque=true")
    simulation = make_simulation(plan)
    simulation.decide()
    state, layout, data = simulation.state, simulation.model.layout, simulation.data
    forces = data.xfrc_applied[layout.bodies[0]]
    arms = data.xipos[layout.bodies[0]] - data.subtree_com[layout.hub_body[0]]
    C_BN = dcm_of(state.q_BN)[0]
    r_B = C_BN @ (state.work[Slot.R_A, 0] @ state.C_mid)
    whole = gravity_gradient_torque(r_B[None], plan.properties.inertia_B[None], plan.environment.gravity.gm)[0]
    total = C_BN @ (np.cross(arms, forces[:, :3]).sum(axis=0) + forces[:, 3:].sum(axis=0))
    assert np.linalg.norm(whole) > 1e-10
    # Thirty kilometres from the origin places are known to 4e-12 m, so that weights seem to turn it by 1e-14 N m.
    assert total == pytest.approx(whole, rel=0, abs=1e-13)
    assert forces[:, :3].sum(axis=0) == pytest.approx(plan.properties.mass * state.work[Slot.A, 0], rel=1e-12)


def test_a_swarm_of_six_and_one_of_four_wheels_settle_and_record_their_sensors(tmp_path):
    axes = {f"wheel_{k}": axis for k, axis in enumerate(((1, 1, 1), (-1, 1, 1), (-1, -1, 1), (1, -1, 1)), 1)}
    sensors = '<jointpos name="mode" joint="fold"/><framequat name="star/tracker" objtype="site" objname="imu"/>'
    flown = (ORTHOGONAL, "[3, 12, 20, 30, 40, 45]", 6, "ideal", 1e-2), (axes, "[12]", 1, "cubesat", 0.1)
    for wheels, points, count, senses, settled in flown:
        text = mjcf(panel(2e-3), wheels=wheels, sensors=sensors)
        plan = plan_of(
            tmp_path,
            text,
            "telemetry.interval_s=30",
            "duration_s=600",
            f"spacecraft.sensors={senses}",
            still=False,
            points=points,
        )
        telemetry = simulate(plan)
        assert telemetry.sizes["spacecraft"] == count and telemetry.sizes["wheel"] == len(wheels)
        assert np.degrees(telemetry["pointing_error"].values[-1].max()) < settled
        assert ("gyro_bias" in telemetry) == (senses == "cubesat")
        # A sensor whose name the telemetry has already is told apart.
        assert np.array_equal(telemetry["sensor_mode"], telemetry["joint_fold_position"])
        assert telemetry["star_tracker"].shape == (21, count, 4)
        assert telemetry["mode"].dtype == np.int8
        assert telemetry["joint_fold_velocity"].attrs["units"] == "rad s-1"


def test_a_timestep_too_long_for_a_stiff_panel_is_refused_and_a_shorter_one_flies(tmp_path):
    from swarm_mj.errors import ScenarioError

    text = mjcf(panel(1e-4, 5), rest=BENT)
    plan = plan_of(tmp_path, text)
    with pytest.raises(
        ScenarioError, match=r"physics\.timestep_s = 0\.5: joint fold of .*moves with 2\.8 Hz.*less than"
    ):
        make_simulation(plan)
    model = mujoco.MjModel.from_xml_path(str(plan.own.path))
    limit = largest_timestep(modes_of(model, np.array(plan.own.start_qpos), ["fold"]))
    # By the step itself: just below the limit forty steps leave the panel small, just above they do not.
    for factor, grows in ((0.97, False), (1.02, True)):
        data = mujoco.MjData(model)
        model.opt.timestep, model.opt.integrator = factor * limit, mujoco.mjtIntegrator.mjINT_RK4
        model.opt.gravity[:] = 0.0
        data.qpos[:] = model.key("start").qpos
        mujoco.mj_step(model, data, nstep=40)
        assert bool(abs(data.joint("fold").qpos[0]) > 0.02) is grows


def test_a_tendon_and_a_servo_are_as_stiff_as_the_spring_that_they_stand_for(tmp_path):
    free = panel(0).replace(f'stiffness="{STIFFNESS}" damping="0"', "")
    tendon = f'<tendon><fixed name="t" stiffness="{STIFFNESS}" damping="1e-3"><joint joint="fold" coef="1"/></fixed></tendon>'
    motors = "".join(MOTOR.format(name=name) for name in ORTHOGONAL)
    servo = motors + f'<position name="hold" joint="fold" kp="{STIFFNESS}" kv="1e-3"/>'
    found = []
    for text in (mjcf(panel(1e-3)), mjcf(free, rest=tendon), mjcf(free, motors=servo)):
        (mode,) = small_motions(plan_of(tmp_path, text).own)
        found.append(mode.eigenvalue)
    assert np.allclose(found, found[0], rtol=1e-7)
    assert found[0].imag == pytest.approx(panel_frequency(1e-3)[0], rel=1e-6)


def test_a_step_that_takes_much_of_a_swing_away_is_remarked_with_how_much(tmp_path):
    # In steps of 0.05 s: measured over 20 s of flight, and as the remark says for 600 s.
    text = mjcf(panel(0, 0.5), rest=BENT)
    plan = plan_of(tmp_path, text, "physics.timestep_s=0.05", "duration_s=600")
    (note,) = [note for note in notes_on(plan.scenario, plan.own) if "physics.timestep_s = 0.05 s take" in note]
    omega = np.sqrt(10) * panel_frequency(0.0)[0]  # of ten times the stiffness
    assert f"joint fold swings with {omega / (2 * np.pi):.3g} Hz" in note
    times, seen, _ = flown(plan, 20.0, 0.5)
    angle, rate = seen["joint_fold_position"][:, 0], seen["joint_fold_velocity"][:, 0]
    amplitude = np.sqrt(angle**2 + (rate / omega) ** 2)
    said = float(note.split(" take ")[1].split(" %")[0]) / 100
    assert 1 - (amplitude[-1] / amplitude[0]) ** (600 / 20) == pytest.approx(said, rel=0.05)
    assert not [
        n for n in notes_on(plan_of(tmp_path, text, "physics.timestep_s=0.01").scenario, plan.own) if "take" in n
    ]


def test_a_diverging_flight_of_an_own_spacecraft_is_named(tmp_path):
    from swarm_mj.errors import SimulationError

    simulation = make_simulation(plan_of(tmp_path, mjcf(panel(0))))
    simulation.data.joint("sc1_fold").qvel[0] = np.nan
    with pytest.raises(SimulationError, match="sc1 has a state that is not finite"):
        simulation.fly(2)


def test_faults_reach_an_own_spacecraft_too(tmp_path):
    lost, weak = (
        "kind: spacecraft_lost, spacecraft: sc1, at_s: 60",
        "kind: wheel_lost, spacecraft: sc2, wheel: 1, at_s: 60",
    )
    faults = f"faults=[{{{lost}}}, {{{weak}}}]"
    plan = plan_of(tmp_path, mjcf(panel(1e-3)), faults, "duration_s=600", still=False, points="[12, 40]")
    telemetry = simulate(plan)
    assert telemetry["operational"].values[-1].tolist() == [0, 1]
    assert np.abs(telemetry["wheel_torque"].values[20:, 1, 0]).max() == 0.0

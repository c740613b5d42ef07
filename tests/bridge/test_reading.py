"""Walkers come in from the files of other simulators."""

from __future__ import annotations

from xml.etree import ElementTree as ET

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gym_passive_walker as gpw
from gym_passive_walker.models.units import PROPORTIONS
from tests.bridge.models import WALKERS

PLAIN = '<robot name="compass"><link name="world"/>{}</robot>'
LEG = """
<link name="{0}"><collision><origin xyz="0 0 -1"/><geometry><sphere radius="0"/></geometry>
</collision></link>
<link name="{0}_mass"><inertial><origin xyz="0 0 -0.5"/><mass value="{1}"/></inertial></link>
<joint name="{0}_weld" type="fixed"><parent link="{0}"/><child link="{0}_mass"/></joint>
"""
HIP = '<link name="hip"><inertial><mass value="10"/>{}</inertial></link>'
JOINTS = """
<joint name="base" type="planar"><parent link="world"/><child link="hip"/><axis xyz="0 1 0"/>
</joint>
<joint name="left" type="fixed"><parent link="hip"/><child link="left_leg"/></joint>
<joint name="pin" type="continuous"><parent link="hip"/><child link="right_leg"/>
<axis xyz="{}"/></joint>
"""


LIMIT = '<limit lower="-3.141592653589793" upper="0.0"'
BENT = '<limit lower="0.0" upper="3.141592653589793"'
KNEE = """ effort="1000000.0" velocity="1000000.0" />
    <dynamics damping="{1}" />
    <parent link="{0}_thigh" />
    <child link="{0}_shank" />"""


def compass(second=5.0, inertia="", axis="0 1 0", more=""):
    """A walker as Drake's published CompassGait.urdf, with changes."""
    legs = LEG.format("left_leg", 5.0) + LEG.format("right_leg", second)
    return PLAIN.format(HIP.format(inertia) + legs + JOINTS.format(axis) + more)


def hanging(place="0 0 0", inertia=""):
    """The same with both legs on hinges, below a hip that floats."""
    hinge = f'name="left" type="continuous"><origin xyz="{place}"/><axis xyz="0 1 0"/>'
    return compass(inertia=inertia).replace('name="left" type="fixed">', hinge)


def turned_round():
    """The same with the hip's mass on the swing leg: the stance leg is the lighter one."""
    light = compass().replace('<mass value="10"/>', '<origin xyz="0 0 -0.5"/><mass value="5"/>')
    light = light.replace(LEG.format("left_leg", 5.0), LEG.format("left_leg", 0.0))
    heavy = """<link name="top"><inertial><mass value="10"/></inertial></link>
    <joint name="top_weld" type="fixed"><parent link="right_leg"/><child link="top"/></joint>"""
    return light.replace("</robot>", heavy + "</robot>")


def of_capsules():
    """The same with feet that are the lower ends of capsules."""
    feet = '<origin xyz="0 0 -0.9"/><geometry><capsule radius="0" length="0.2"/>'
    return compass().replace('<origin xyz="0 0 -1"/><geometry><sphere radius="0"/>', feet)


def with_shins():
    """The same with a cylinder along each leg that collides."""
    shin = '<collision><geometry><cylinder radius="2" length="1"/></geometry></collision></link>'
    return compass().replace("</collision></link>", f"</collision>{shin}")


def damped(one, other):
    """The same below a hip that floats, with these coefficients of friction at its hinges."""
    text = hanging()
    for leg, value in (("left", one), ("right", other)):
        child = f'<parent link="hip"/><child link="{leg}_leg"/>'
        text = text.replace(child, f'{child}<dynamics damping="{value}"/>')
    return text


def with_circle(kind):
    """The same beside three bodies that hang on each other."""
    links = "".join(
        f"""<link name="{a}"><inertial><mass value="1"/></inertial></link>
        <joint name="{a}{b}" type="{kind}"><parent link="{a}"/><child link="{b}"/>
        <axis xyz="0 1 0"/></joint>"""
        for a, b in ("ab", "bc", "ca")
    )
    return compass(more=links)


def toe(parent, axis):
    """A body on a hinge, and the end of a file."""
    return f"""<link name="toe"><inertial><mass value="1"/></inertial></link>
    <joint name="toe_pin" type="continuous"><parent link="{parent}"/><child link="toe"/>
    <axis xyz="{axis}"/></joint></robot>"""


def frame(place, turn):
    """A frame, (4, 4), at a place and turned."""
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = turn.as_matrix(), place
    return made


def in_other_frames(text, seed):
    """The same bodies, with each link's frame turned at random and moved along its hinge.

    Moments of inertia are about axes that are turned too, and differ across the plane.
    """
    rng, root = np.random.default_rng(seed), ET.fromstring(text)
    turns = {link.get("name"): Rotation.from_quat(rng.normal(size=4)) for link in root.iter("link")}
    made = {name: frame([0.0, 0.0, rng.normal()], turn) for name, turn in turns.items()}

    def move(element, before, after):
        """Change an element's <origin>, between two frames."""
        origin = element.find("origin")
        place, angles = (np.array(origin.get(x, "0 0 0").split(), float) for x in ("xyz", "rpy"))
        moved = np.linalg.inv(before) @ frame(place, Rotation.from_euler("xyz", angles)) @ after
        angles = Rotation.from_matrix(moved[:3, :3]).as_euler("xyz")
        for name, numbers in (("xyz", moved[:3, 3]), ("rpy", angles)):
            origin.set(name, " ".join(map(repr, numbers.tolist())))

    for link in root.iter("link"):
        for collision in link.findall("collision"):
            move(collision, made[link.get("name")], np.eye(4))
        for inertial in link.findall("inertial"):
            turn = Rotation.from_quat(rng.normal(size=4))
            move(inertial, made[link.get("name")], frame(np.zeros(3), turn))
            given = inertial.find("inertia")
            about = turn.inv().as_matrix()
            moments = about @ np.diag([0.7, 0.6, 1.0]) @ about.T * float(given.get("izz"))
            for name in ("ixx", "iyy", "izz", "ixy", "ixz", "iyz"):
                row, column = ("xyz".index(letter) for letter in name[1:])
                given.set(name, repr(float(moments[row, column])))
    for joint in root.findall("joint"):
        above, below = (made[joint.find(end).get("link")] for end in ("parent", "child"))
        move(joint, above, below)
        axis = 2.0 * below[2, :3]  # of any length
        joint.find("axis").set("xyz", " ".join(map(repr, axis.tolist())))
    return ET.tostring(root, "unicode")


@pytest.fixture
def read(tmp_path):
    """A function that reads a walker from the text of a URDF."""

    def reading(text, name="compass.urdf"):
        path = tmp_path / name
        path.write_text(text, "utf-8")
        return gpw.Walker.from_urdf(path)

    return reading


@pytest.mark.parametrize("ending", ["xml", "urdf"])
@pytest.mark.parametrize("name", WALKERS)
def test_a_file_of_a_walker_is_that_walker(name, ending, tmp_path):
    if ending == "xml":
        pytest.importorskip("mujoco")
    walker, path = WALKERS[name].with_parameters(hip_friction=1e-4), tmp_path / f"walker.{ending}"
    gpw.export(walker, path)
    found = (gpw.Walker.from_mjcf if ending == "xml" else gpw.Walker.from_urdf)(path)
    assert found.knees == walker.knees and found.title == "walker"
    if walker.knees:
        for each in PROPORTIONS:
            assert getattr(found, each) == pytest.approx(getattr(walker, each), abs=1e-9), each
    else:  # a straight leg has one body, not two
        slope = 0.01 if name == "F" else 0.03
        gaits = [gpw.find_gait(each, slope) for each in (walker, found)]
        assert gaits[1].state == pytest.approx(gaits[0].state, abs=2e-6)  # feet of 1e-6 m


def test_the_published_compass_walker_comes_in_and_has_its_gait(read):
    """Hip 10 kg, legs 5 kg at half their length of 1 m: Drake's examples, and its gait."""
    walker = read(compass())
    assert (walker.hip_mass, walker.total_mass, walker.leg_length) == (10.0, 20.0, 1.0)
    assert walker.foot_radius == 0.0 and not walker.knees
    stated = gpw.Walker(
        thigh_length=0.5, thigh_mass=5.0, thigh_com=0.5, shank_length=0.5, shank_mass=0.0,
        hip_mass=10.0, knees=False,
    )  # fmt: skip
    gait = gpw.find_gait(walker, 0.0525)
    assert gait.stable
    assert gait.state == pytest.approx(gpw.find_gait(stated, 0.0525).state, abs=1e-12)


@pytest.mark.parametrize("turned", [0.0, 0.3, -0.3])
def test_it_does_not_matter_how_the_file_s_legs_stand(turned, read):
    upright, leaning = (
        read(compass().replace('name="left" type="fixed">', f'name="left" type="fixed">{origin}'))
        for origin in ("", f'<origin rpy="0 {turned} 0"/>')
    )
    assert leaning.body == pytest.approx(upright.body, abs=1e-12)


@pytest.mark.parametrize(
    "text",
    [hanging(), hanging("0 0.1 0"), turned_round(), of_capsules(), with_shins()],
)
def test_one_walker_has_many_files(text, read):
    assert read(text).body == pytest.approx(read(compass()).body, abs=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_walker_is_the_same_in_any_frames(seed, read, tmp_path):
    """Frames may be turned and lie anywhere on the hinges; only moments about these count."""
    walker, path = gpw.WALKERS["lab"].with_parameters(hip_friction=1e-4), tmp_path / "lab.urdf"
    gpw.export(walker, path)
    found = read(in_other_frames(path.read_text("utf-8"), seed))
    assert found.knees is True
    for each in PROPORTIONS:
        assert getattr(found, each) == pytest.approx(getattr(walker, each), abs=1e-12), each


@pytest.mark.parametrize(
    ("one", "other", "both"), [(0.3, 0.6, 0.2), (0.3, 0.0, 0.0), (0.0, 0.3, 0.0)]
)
def test_two_hinges_of_a_hip_without_inertia_act_in_series(one, other, both, read):
    """1 / both = 1 / one + 1 / other: the moment of the hinges is the same."""
    assert read(damped(one, other)).hip_friction == pytest.approx(both, abs=1e-15)


@pytest.mark.parametrize(("more", "hip"), [(1e-7, 0.0), (-1e-7, 0.0), (1e-5, 1e-5), (-1e-5, 1e-5)])
def test_a_mass_of_the_hip_is_more_than_rounding(more, hip, read, tmp_path):
    """It is what one leg has more than the other; relative differences below 1e-6 are rounding."""
    gpw.export("lab", tmp_path / "lab.urdf")
    text = (tmp_path / "lab.urdf").read_text("utf-8")
    first = text.replace('<mass value="2.345"', f'<mass value="{2.345 + more}"', 1)
    assert read(first).hip_mass == pytest.approx(hip, abs=1e-12)


def test_friction_of_the_hip_is_read_whichever_leg_is_heavier(read):
    hinge = '<child link="right_leg"/>'
    text = turned_round().replace(hinge, f'{hinge}<dynamics damping="0.3"/>')
    assert read(text).hip_friction == 0.3


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</robot>", toe("right_shank", "0 0 1"), "toe hangs on a foot"),
        ("</robot>", toe("left_shank", "0 0 1"), "right_hip is not on the axis of"),
        (KNEE.format("right", "0.0"), KNEE.format("right", "0.1"),
         "right_knee has damping, which a Walker's knee has not"),
        (KNEE.format("left", "0.0"), KNEE.format("left", "0.1"),
         "left_knee has damping, which a Walker's knee has not"),
        (KNEE.format("left", "0.0"), KNEE.format("left", '0.0" friction="0.1'),
         "left_knee has friction, which a Walker's joints have not"),
        (LIMIT + KNEE.format("left", "0.0"), BENT + KNEE.format("left", "0.0"),
         "left_knee and right_knee bend opposite ways"),
    ],
)  # fmt: skip
def test_kneed_legs_have_two_links_and_knees_without_friction(old, new, said, read, tmp_path):
    gpw.export("lab", tmp_path / "lab.urdf")
    text = (tmp_path / "lab.urdf").read_text("utf-8")
    assert text.count(old) == 1
    with pytest.raises(gpw.WalkerError, match=said):
        read(text.replace(old, new))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (hanging("0.1 0 0"), "pin is not on the axis of left"),
        (hanging(inertia='<inertia ixx="1" iyy="1" izz="1"/>'),
         "hip has a moment of inertia about the hip, where a Walker has a point mass"),
        (hanging(inertia='<origin xyz="0.1 0 0"/>'), "hip has a moment of inertia about the hip"),
        (PLAIN.format(HIP.format("")), "it has no hinge"),
        (compass().replace('"right_leg"><collision><origin xyz="0 0 -1"',
                           '"right_leg"><collision><origin xyz="0 0 -1.1"'),
         "hip and right_leg have different lengths"),
        ("nonsense", "is no model, for it is no XML"),
        ("<mujoco/>", "is no model: its root is <mujoco>, and not <robot>"),
        ('<robot name="x"><link/></robot>', "is no model: 'name'"),
        (PLAIN.format(""), "it has 0 bodies with mass that hang on nothing"),
        (compass(second=6.0), "hip and right_leg have different masses"),
        (compass(inertia='<inertia ixx="1" iyy="1" izz="1"/>'), "hip and right_leg have different"),
        (compass(axis="1 1 0"), None),
        (compass(more=LEG.format("third_leg", 5.0) + '<joint name="third" type="continuous">'
                 '<parent link="hip"/><child link="third_leg"/><axis xyz="0 1 0"/></joint>'),
         "third_leg would be a third leg"),
        (compass().replace("</robot>", toe("right_leg", "1 0 0")),
         "the hinge toe_pin is not parallel to pin"),
        (compass().replace("</robot>", toe("right_leg", "0 1 0")),
         "toe is one link too many, or one of its legs has too few"),
        (compass().replace('<sphere radius="0"/>', '<mesh filename="foot.stl"/>'), "has no foot"),
        (compass().replace('type="continuous"', 'type="prismatic"'),
         "right_leg needs one hinge, and has pin"),
        (compass().replace('<sphere radius="0"/>', '<cylinder radius="0.1" length="0.5"/>'),
         "has no foot: a sphere, or a cylinder across the plane"),
        (with_circle("fixed"), "a, c, b are welded in a circle"),
        (with_circle("continuous"), "a hangs on itself, in a circle of joints"),
        (compass().replace('type="planar">', 'type="planar"><dynamics damping="1"/>'),
         "base has a spring, friction or armature, where a Walker moves freely"),
        (compass().replace('xyz="0 0 -0.5"', 'xyz="0 0 0"'),
         "mass without inertia about its hinge"),
        (compass().replace("<geometry>", "<form>").replace("</geometry>", "</form>"),
         "a collision of .* needs a geometry of one shape"),
        ('<?xml version="1.0" encoding="none"?>' + compass(), "it is no XML: unknown encoding"),
    ],
)  # fmt: skip
def test_what_is_no_walker_is_refused_by_the_name_of_its_element(text, said, read):
    if said is None:  # a hinge that is askew is the only one, and the plane is its own
        assert read(text).hip_mass == 10.0
        return
    with pytest.raises(gpw.WalkerError, match=said) as refused:
        read(text)
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there_is_refused(tmp_path):
    for reading in (gpw.Walker.from_urdf, gpw.Walker.from_mjcf):
        with pytest.raises(gpw.WalkerError, match=r"nowhere\.xml cannot be read: No such file"):
            reading(tmp_path / "nowhere.xml")


def test_mujoco_s_own_complaint_about_a_file_is_passed_on(tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "walker.xml"
    path.write_text("<mujoco><worldbody><body><joint/></body></worldbody></mujoco>", "utf-8")
    with pytest.raises(gpw.WalkerError, match=r"walker\.xml is no model: .*mass and inertia"):
        gpw.Walker.from_mjcf(path)


@pytest.fixture
def changed(tmp_path):
    """A function that changes a joint in a file of MuJoCo, and reads its walker."""
    pytest.importorskip("mujoco")
    walker = gpw.WALKERS["lab"].with_parameters(hip_stiffness=0.5, knee_stiffness=0.3)
    path = tmp_path / "lab.xml"
    gpw.export(walker, path)

    def reading(name, **attributes):
        tree = ET.parse(path)
        (joint,) = (each for each in tree.iter("joint") if each.get("name") == name)
        joint.attrib.update(attributes)
        changed = tmp_path / "changed.xml"
        tree.write(changed)
        return gpw.Walker.from_mjcf(changed)

    return reading


@pytest.mark.parametrize(
    ("joint", "attributes", "said"),
    [
        ("left_knee", {"stiffness": "0.4"}, "left_knee and right_knee have different springs"),
        ("left_knee", {"damping": "0.1"}, "left_knee has damping"),
        ("left_knee", {"ref": "-0.3"}, "left_thigh and right_thigh have different"),
        ("right_hip", {"ref": "0.3"}, "the spring of right_hip is not at rest where the legs"),
        ("right_hip", {"springref": "0.3"}, "right_hip has springref, which a Walker's joints"),
        ("right_hip", {"armature": "0.1"}, "right_hip has armature, which a Walker's joints"),
        ("right_knee", {"frictionloss": "0.1"}, "right_knee has frictionloss, which a Walker's"),
        ("pitch", {"stiffness": "0.1"}, "pitch has a spring, friction"),
    ],
)
def test_properties_of_all_joints_in_a_file_of_mujoco_count(joint, attributes, said, changed):
    with pytest.raises(gpw.WalkerError, match=said):
        changed(joint, **attributes)


_TENDON = '<tendon><fixed stiffness="9"><joint joint="right_hip" coef="1"/></fixed></tendon>'
_GRAVITY = 'gravity="0.0 0.0 -9.81"'


@pytest.mark.parametrize(
    ("usual", "changed", "said"),
    [
        ('active="false"', 'active="true"', "an equality constraint acts on it"),
        ("<equality>", f"{_TENDON}<equality>", "a tendon acts on it"),
        ('<body name="left_shank"', '<body gravcomp="1" name="left_shank"', "gravcomp acts on it"),
        ("<option", '<option density="1000"', "a fluid acts on it"),
        (_GRAVITY, 'gravity="0 -9.81 0"', "gravity acts across its plane"),
        ("<option", '<option><flag gravity="disable"/></option><option', "gravity must be posit"),
    ],
)
def test_what_else_acts_in_a_file_of_mujoco_is_refused(usual, changed, said, tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "lab.xml"
    gpw.export("lab", path)
    path.write_text(path.read_text("utf-8").replace(usual, changed, 1), "utf-8")
    with pytest.raises(gpw.WalkerError, match=said):
        gpw.Walker.from_mjcf(path)


def test_a_joint_of_a_urdf_that_mimics_another_is_refused(tmp_path):
    path = tmp_path / "lab.urdf"
    gpw.export("lab", path)
    head, hip, rest = path.read_text("utf-8").partition('<joint name="right_hip"')
    rest = rest.replace("<dynamics", '<mimic joint="left_knee" /><dynamics', 1)
    path.write_text(head + hip + rest, "utf-8")
    with pytest.raises(gpw.WalkerError, match="right_hip has mimic"):
        gpw.Walker.from_urdf(path)


def test_the_angle_of_a_hinge_in_the_file_does_not_change_the_walker(changed):
    """`ref` is the angle between the legs in the file; a spring would have to be at rest at 0."""
    usual, apart = (changed("right_hip", stiffness="0", ref=ref) for ref in ("0", "0.3"))
    assert apart.body == pytest.approx(usual.body, abs=1e-12)


FLOATING = """<mujoco><worldbody><body><freejoint/>
<inertial mass="10" pos="0 0 0" diaginertia="1e-9 1e-9 1e-9"/>
<body><joint name="left" axis="0 1 0" {}/><geom size="0.1" pos="0 0 -1" mass="1"/></body>
<body><joint name="right" axis="0 1 0" {}/><geom size="0.1" pos="0 0 -1" mass="1"/></body>
</body></worldbody></mujoco>"""


@pytest.mark.parametrize(
    ("one", "other", "both"),
    [
        ('stiffness="3" damping="0.3"', 'stiffness="6" damping="0.6"', (2.0, 0.2)),
        ('stiffness="3"', "", (0.0, 0.0)),
        ('stiffness="3"', 'damping="0.3"', None),
    ],
)
def test_a_spring_in_series_with_a_damper_is_no_hip_of_a_walker(one, other, both, tmp_path):
    pytest.importorskip("mujoco")
    path = tmp_path / "floating.xml"
    path.write_text(FLOATING.format(one, other), "utf-8")
    if both is None:
        with pytest.raises(gpw.WalkerError, match="left and right have springs and friction in"):
            gpw.Walker.from_mjcf(path)
    else:
        found = gpw.Walker.from_mjcf(path)
        assert (found.hip_stiffness, found.hip_friction) == pytest.approx(both, abs=1e-15)

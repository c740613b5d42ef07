"""Walkers come in from the files of other simulators."""

from __future__ import annotations

import pytest

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


def toe(parent, axis):
    """A body on a hinge, and the end of a file."""
    return f"""<link name="toe"><inertial><mass value="1"/></inertial></link>
    <joint name="toe_pin" type="continuous"><parent link="{parent}"/><child link="toe"/>
    <axis xyz="{axis}"/></joint></robot>"""


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


@pytest.mark.parametrize("text", [hanging(), hanging("0 0.1 0"), turned_round(), of_capsules()])
def test_one_walker_has_many_files(text, read):
    assert read(text).body == pytest.approx(read(compass()).body, abs=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("</robot>", toe("right_shank", "0 0 1"), "toe hangs on a foot"),
        ("</robot>", toe("left_shank", "0 0 1"), "right_hip is not on the axis of"),
        ('<dynamics damping="0.0" />\n    <parent link="right_thigh" />',
         '<dynamics damping="0.1" />\n    <parent link="right_thigh" />',
         "right_knee has damping, which a Walker's knee has not"),
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
        (compass().replace('xyz="0 0 -0.5"', 'xyz="0 0 0"'),
         "mass without inertia about its hinge"),
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

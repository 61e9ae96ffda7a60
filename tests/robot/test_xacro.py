"""xacro files: the same tree as the package ``xacro`` makes, or a refusal that names the line."""

from __future__ import annotations

import io
import itertools
import math
import os
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
from tests.robot.urdf_kit import Step, written
from tests.robot.xacro_kit import by_armctl, by_package, robot, write

from armctl import load_robot
from armctl.errors import RobotFileError
from armctl.robot.urdf import UrdfSource, install_package, read_urdf_file
from armctl.robot.urdf.reading import parse_xml
from armctl.robot.urdf.xacro import expand

YAML = """
limits:
  shoulder: {lower: !degrees -90, upper: !radians 1.5, fast: yes}
  elbow: {lower: !degrees 45 * 2, upper: 2.5, reach: !millimeters 120}
units: [!meters 1, !foot 1, !inches 2 + 1]
names: [base, upper, fore]
empty:
made: 2024-05-06
left: &finger {mass: 0.5, xyz: 0 0 1}
right: *finger
"""

PLAIN = {
    "properties": """<xacro:property name="a" value="2"/><xacro:property name="b" value="${a * 3}"/>
        <xacro:property name="t" value="'7'"/><xacro:property name="u" value="1_5"/>
        <xacro:property name="yes" value="true"/>
        <link name="l${a}" mass="${b}" plus="${t + 1}" under="${u + 'x'}" two="${a}${b}" yes="${yes}"/>""",
    "a property is evaluated when it is asked for": """<xacro:property name="b" value="${a}"/>
        <xacro:property name="a" value="5"/><link name="${b}"/><xacro:property name="a" value="6"/>
        <link name="${b} ${a}"/>""",
    "a property that is evaluated at once": """<xacro:property name="a" value="1"/>
        <xacro:property name="b" value="${a}" lazy_eval="false"/><xacro:property name="a" value="2"/>
        <link name="${b}"/>""",
    "a default of a property": """<xacro:property name="a" default="1"/>
        <xacro:property name="a" default="2"/><xacro:property name="sum" default="3"/>
        <link name="${a} ${sum}"/>""",
    "a property is removed": """<xacro:property name="a" value="1"/>
        <xacro:property name="a" remove="true"/><xacro:property name="a" default="2"/><link name="${a}"/>""",
    "a property named by another one": """<xacro:property name="which" value="left"/>
        <xacro:property name="${which}_mass" value="3"/><link name="${left_mass}"/>""",
    "a property redefined by itself": """<xacro:property name="n" value="1"/>
        <xacro:property name="n" value="${n + 1}" lazy_eval="false"/><link name="${n}"/>""",
    "numbers": """<link a="${1}" b="${1.0}" c="${1e-7}" d="${10 / 4}" e="${10 // 4}" f="${-7 % 3}"
        g="${2 ** 10}" h="${1e16}" i="${0.1 + 0.2}" j="${int(3.9)}" k="${float('2')}" l="${round(2.5)}"
        m="${round(2.567, 2)}" n="${round(1.5, 0)}" o="${max(1, 2.5)}" p="${min([3, 1])}" q="${inf}"
        r="${+1 - -1}"/>""",
    "mathematics": """<link a="${pi}" b="${radians(30)}" c="${sin(pi / 2)}" d="${math.atan2(1, 2)}"
        e="${math.sqrt(2)}" f="${hypot(3, 4)}" g="${floor(2.7)} ${ceil(2.1)}" h="${degrees(1)}"
        i="${tau} ${e}" j="${python.abs(-3)} ${python.sum([1, 2])} ${fabs(-1)}"
        k="${log(2)} ${exp(1)} ${pow(2, 3)}"/>""",
    "texts": """<xacro:property name="t" value="Left_Arm"/><link a="${t.lower()}" b="${t.upper()[0:2]}"
        c="${t[-1]}" d="${t.replace('_', '-')}" e="${'a,b c'.split(',')[1]}" f="${'-'.join(['x', 'y'])}"
        g="${len(t)}" h="${t.startswith('Left') and t.endswith('Arm')}" i="${' x '.strip()}|"
        j="${'_' in t}" k="${'a' * 3}" l="${'1' + str(2)}" m="${t.find('A')} ${t.index('A')} ${t.count('e')}"
        n="${xacro.tokenize('a, b;c')} ${xacro.tokenize('a=b', sep='=')}"/>""",
    "lists and dictionaries": """<xacro:property name="l" value="${[1, 'b', 2.5]}"/>
        <xacro:property name="d" value="${dict(a=1, b='x')}"/><xacro:property name="t" value="${(1, 2)}"/>
        <link a="${l}" b="${l[1]} ${l[-1]} ${l[1:]} ${l[::2]}" c="${d['a']} ${d}" d="${len(d)} ${'b' in d}"
        e="${t}" f="${l + [3]}" g="${list(d.items())}" h="${[i * 2 for i in python.range(4) if i != 2]}"
        i="${sorted([3, 1, 2])}" j="${[k + v for k, v in [('a', 'b'), ('c', 'd')]]}"
        k="${xacro.dotify(d).b}" l="${list(map(float, '1 2 3'.split()))}"
        m="${python.any([0, 1])} ${python.all([0, 1])}" o="${d.get('z', 9)}"
        n="${python.isinstance(l, list)} ${python.isinstance(1, (float, int))}"/>""",
    "conditions": """<xacro:property name="a" value="3"/>
        <xacro:if value="${a > 2}"><link name="more"/></xacro:if>
        <xacro:unless value="${a > 2}"><link name="less"/></xacro:unless>
        <xacro:if value="0"><link name="no"/></xacro:if>
        <xacro:if value="true"><link name="yes"/><xacro:if value="False"><link/></xacro:if></xacro:if>
        <link a="${1 if a == 3 else 2}" b="${a == 3 and 'x' or 'y'}" c="${not a}" d="${1 &lt; a &lt;= 3}"
        e="${a in [1, 2]} ${a not in (1, 2)}" f="${None is None} ${a is not None}" g="${a != 3}"/>""",
    "a list that is used up": """<xacro:property name="rest" value="${['a', 'b', 'c']}"/>
        <xacro:macro name="each" params="rest"><xacro:if value="${rest}">
        <xacro:property name="one" value="${rest.pop(0)}"/><link name="${one}"/><xacro:each rest="${rest}"/>
        </xacro:if></xacro:macro><xacro:each rest="${rest}"/>""",
    "macros": """<xacro:macro name="part"
          params="name parent:=base mass:=1.5 text:='x y' sum:=${1+2} *shape **more">
        <link name="${name}" parent="${parent}" mass="${mass * 2}" text="${text}" sum="${sum}">
        <xacro:insert_block name="shape"/><xacro:insert_block name="more"/><xacro:insert_block name="more"/>
        </link></xacro:macro>
        <xacro:part name="one" mass="2"><box size="${1 + 1}"/><all><x/>text<y a="${3}"/></all></xacro:part>
        <xacro:part name="two" parent="one"><xacro:if value="1"><box/></xacro:if><all/></xacro:part>""",
    "parameters passed through": """<xacro:property name="left" value="L"/>
        <xacro:property name="up" value="U"/>
        <xacro:macro name="inner" params="left:=^ up:=^|none down:=^|D other=^|'a b'">
        <link name="${left}${up}${down}" other="${other}"/></xacro:macro><xacro:inner/>
        <xacro:macro name="outer" params="left down"><xacro:inner/><xacro:inner left="x"/></xacro:macro>
        <xacro:outer left="l" down="d"/>""",
    "macros see their caller": """<xacro:macro name="who" params=""><link name="${me}"/></xacro:macro>
        <xacro:macro name="call_it" params="me"><xacro:who/></xacro:macro>
        <xacro:property name="me" value="top"/><xacro:who/><xacro:call_it me="caller"/>""",
    "macros defined in macros": """<xacro:macro name="make" params="a"><xacro:macro name="made" params="b">
        <link name="${a}${b}"/></xacro:macro><xacro:made b="1"/></xacro:macro><xacro:make a="x"/>
        <xacro:macro name="twice" params="n"><xacro:if value="${n}"><joint name="j${n}"/>
        <xacro:twice n="${n - 1}"/></xacro:if></xacro:macro><xacro:twice n="3"/>""",
    "macros redefined": """<xacro:macro name="m" params="a:=1"><link name="old"/></xacro:macro><xacro:m/>
        <xacro:macro name="m" params="b:=2"><link name="new${b}"/></xacro:macro><xacro:m b="3"/>""",
    "scopes": """<xacro:property name="a" value="0"/><xacro:macro name="set" params="x">
        <xacro:property name="a" value="${x}"/><xacro:property name="up" value="${x + 1}" scope="parent"/>
        <xacro:property name="top" value="${x + 2}" scope="global"/><link name="${a}"/></xacro:macro>
        <xacro:macro name="outer" params=""><xacro:set x="5"/><link name="${up}"/></xacro:macro>
        <xacro:outer/><xacro:set x="7"/><link name="${a} ${up} ${top}"/>""",
    "blocks of properties": """<xacro:property name="shape"><box size="${s}"/>text ${s}<xacro:tag/>
        </xacro:property><xacro:macro name="tag" params=""><tag/></xacro:macro>
        <xacro:property name="s" value="4"/><link><xacro:insert_block name="shape"/></link>
        <xacro:property name="s" value="5"/><link><xacro:insert_block name="shape"/></link>""",
    "calls by name": """<xacro:macro name="m_a" params="x"><link name="${x}"/></xacro:macro>
        <xacro:property name="which" value="a"/><xacro:call macro="m_${which}" x="1"/>""",
    "elements and attributes by name": """<xacro:property name="tag" value="link"/>
        <xacro:element xacro:name="${tag}" name="one"><x/></xacro:element>
        <link><xacro:attribute name="${'na' + 'me'}" value="${tag}2"/></link>
        <link><xacro:if value="1"><xacro:attribute name="lost" value="1"/><y/></xacro:if></link>""",
    "arguments": """<xacro:arg name="given" default="no"/><xacro:arg name="own" default="${1 + 1}"/>
        <xacro:arg name="path" default="$(arg own)/x"/><link name="$(arg given)" own="$(arg own)"
        path="$(arg path)" sum="${$(arg own) + 1}" text="${'$(arg given)' + '!'}" by="${xacro.arg('given')}"
        eval="$(eval own * 2 + 1)" which="$(eval 'a' if given == 'given' else 'b')"/>""",
    "environment": """<link name="$(optenv NO_SUCH_VARIABLE)|" other="$(optenv NO_SUCH_VARIABLE a b)"/>""",
    "dollars": """<link a="$${x}" b="$$$(arg x)" c="5 $ x" d="cost $" e="$$${1}">$${text} ${1 + 1}</link>
        <xacro:property name="f" value="$${x}"/><link f="${f}"/>""",
    "text": """<link>one ${1 + 1}<x/>three ${3}<!-- ${undefined} --></link>
        <plugin><![CDATA[a ${b} &]]></plugin>""",
    "names of XML": """<xacro:macro name="m" params="" xmlns:cam="http://cam"><link cam:a="1"/></xacro:macro>
        <xacro:m/>""",
    "messages": """<link name="${xacro.warning('a')}${xacro.message('b', color='red')}x"/>
        ${xacro.print_location()}""",
    "a macro that is not called": """<xacro:macro name="unused" params="a"><link name="${a + undefined}"/>
        <xacro:unused a="1"/></xacro:macro><link name="a"/>""",
}
FILES = {
    "includes": {
        "arm.xacro": """<xacro:include filename="parts/one.xacro"/>
            <xacro:include filename="$(find my_arm)/two.xacro"/><xacro:include filename="parts/z_*.xacro"/>
            <xacro:include filename="none.xacro" optional="true"/><xacro:include filename="none*.xacro"/>
            <xacro:one/><link name="${two} ${one}"/>""",
        "parts/one.xacro": """<xacro:include filename="deeper/three.xacro"/>
            <xacro:property name="one" value="${three}"/>
            <xacro:macro name="one" params=""><link name="by_macro"/></xacro:macro><link name="of_one"/>""",
        "parts/deeper/three.xacro": '<xacro:property name="three" value="3"/>',
        "parts/z_b.xacro": '<link name="b"/>',
        "parts/z_a.xacro": '<link name="a"/>',
        "two.xacro": '<xacro:property name="two" value="2"/>',
        "package.xml": "<package><name>my_arm</name></package>",
    },
    "namespaces": {
        "arm.xacro": """<xacro:property name="size" value="9"/>
            <xacro:include filename="part.xacro" ns="p"/><xacro:p.make name="one"/>
            <link name="${p.size} ${size} ${p.made}"/><xacro:property name="which" value="p"/>
            <xacro:call macro="${which}.make" name="two"/>""",
        "part.xacro": """<xacro:property name="size" value="3"/>
            <xacro:property name="made" value="${size * 2}"/>
            <xacro:macro name="make" params="name"><link name="${name}" size="${size}"/><xacro:helper/>
            </xacro:macro>
            <xacro:macro name="helper" params=""><link name="helper${made}"/></xacro:macro>""",
    },
    "YAML": {
        "arm.xacro": """<xacro:property name="c" value="${xacro.load_yaml('config/c.yaml')}"/>
            <xacro:property name="d" value="${load_yaml('$(find my_arm)/config/c.yaml')['limits']}"/>
            <link a="${c['limits']['shoulder']['lower']}" b="${c.limits.elbow.upper}" c="${d.elbow.lower}"
            d="${c.names} ${c.names[1]}" e="${c.empty}" f="${c.units}" g="${d.shoulder.fast} ${d.elbow.reach}"
            h="${'limits' in c} ${len(c['names'])}" i="${c.made}" j="${c.right}"
            k="${c.right.xyz.split()[2]}" l="${[n for n in c.names]} ${list(d.keys())}"/>""",
        "config/c.yaml": YAML,
        "package.xml": "<package><name>my_arm</name></package>",
    },
    "formats": {
        "arm.xacro": """<xacro:property name="c" value="${load_yaml('c.yaml')}"/>
            <link a="${c.plain.format(1, n='x')}" b="${c.wide.format(1.23456, 7, 'a')}"
            c="${c.twice.format(c.wide)}" d="${[c.one.format(i) for i in python.range(3)]}"/>""",
        "c.yaml": 'plain: "{}_{n}"\nwide: "{:.3f}|{:5d}|{:>4}|{{}}"\ntwice: "{0}{0}"\none: "j{}"',
    },
    "packages": {
        "ws/my_arm/urdf/arm.urdf.xacro": """<xacro:include filename="$(find other)/x.xacro"/>
            <xacro:include filename="${'$(find my_arm)'}/urdf/y.xacro"/><link name="${x} ${y}"/>""",
        "ws/my_arm/urdf/y.xacro": '<xacro:property name="y" value="2"/>',
        "ws/my_arm/package.xml": "<package><name>my_arm</name></package>",
        "ws/other/x.xacro": '<xacro:property name="x" value="1"/>',
        "ws/other/package.xml": "<package><name>other</name></package>",
    },
    "a folder without a package.xml": {
        "my_arm/urdf/arm.xacro": """<xacro:include filename="$(find my_arm)/parts/x.xacro"/>
            <link name="${x}"/>""",
        "my_arm/parts/x.xacro": '<xacro:property name="x" value="1"/>',
    },
}


@pytest.mark.parametrize("feature", [*PLAIN, *FILES])
def test_the_tree_is_that_of_the_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, feature: str
) -> None:
    file = write(tmp_path, FILES.get(feature, {"arm.xacro": PLAIN.get(feature, "")}))
    arguments = {"given": "given"} if feature == "arguments" else {}
    made = by_armctl(file, arguments)
    assert made[3], "the feature makes no element"
    assert made == by_package(file, monkeypatch, arguments)


MACRO = """<xacro:macro name="step" params="joint kind parent child **where"><link name="${child}"/>
  <joint name="${joint}" type="${kind}"><parent link="${parent}"/><child link="${child}"/>
  <limit lower="${-reach}" upper="${reach}" effort="1" velocity="2"/>
  <xacro:insert_block name="where"/></joint>
</xacro:macro>"""
STEPS = (
    Step("pan", "revolute", "base", "body", "0 0 0.1"),
    Step("lift", "revolute", "body", "upper", "0.02 0 0.05", axis="0 1 0"),
    Step("elbow", "revolute", "upper", "lower", "0 0 0.2", axis="0 1 0"),
    Step("end", "fixed", "lower", "tool0", "0 0 0.15"),
)


CALLS = "".join(
    f"""<xacro:step joint="{step.joint}" kind="{step.kind}" parent="{step.parent}" child="{step.child}">
    <where><origin xyz="{step.xyz}" rpy="{step.rpy}"/><axis xyz="{step.axis}"/></where></xacro:step>"""
    for step in STEPS
)
ARM = {
    "my_arm/urdf/arm.urdf.xacro": f"""<xacro:include filename="$(find my_arm)/urdf/step.xacro"/>
        <xacro:property name="reach" value="${{load_yaml('../config/c.yaml').reach}}"/>
        <link name="base"/>{CALLS}<gazebo><plugin file="$(find my_gazebo)/x.yaml"/></gazebo>""",
    "my_arm/urdf/step.xacro": MACRO,
    "my_arm/config/c.yaml": "reach: 2.5",
    "my_arm/package.xml": "<package><name>my_arm</name></package>",
}
"""an arm of macros, in a package of its own"""


@pytest.mark.parametrize("way", ["file", "zip", "page"])
def test_an_arm_of_macros_is_loaded_whichever_way_it_comes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, way: str
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    path = write(tmp_path, ARM)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w") as packed:
        for name in ARM:
            packed.write(tmp_path / name, name)
    if way == "zip":
        path = tmp_path / "packed.zip"
        path.write_bytes(stream.getvalue())
    elif way == "page":
        path = install_package("packed.zip", stream.getvalue(), tmp_path / "robots")
    made, plain = load_robot(path), load_robot(written(tmp_path / "plain.urdf", STEPS))
    assert made.joint_names == plain.joint_names == ("pan", "lift", "elbow")
    q = np.array([0.3, -0.5, 0.7])
    assert made.forward(q) == pytest.approx(plain.forward(q), abs=1e-12)
    assert made.limits == pytest.approx(plain.limits)


@pytest.mark.parametrize(
    ("content", "line", "says"),
    [
        ("\n<link name='${none}'/>", 2, "there is no property 'none'"),
        ("<link\n name='a'/>\n\n<joint name='${1 / 0}'/>", 4, "division by zero"),
        ("\n\n<xacro:none/>", 3, "<xacro:none>: there is no such macro"),
        ("\n<link name='$(arg model)'/>", 2, "the argument 'model' is needed, and the file gives it no"),
        ("\n<xacro:arg name='model'/><link name='$(arg model)'/>", 2, "the argument 'model' is needed"),
        ("\n<link name='$(find nowhere)'/>", 2, r"\$\(find nowhere\): no folder above the file holds"),
        ("\n<xacro:if value='maybe'/>", 2, 'condition "maybe" is "maybe", which is neither true nor false'),
        ("\n<xacro:insert_block name='b'/>", 2, 'insert_block name="b">: there is no such block'),
        ("\n<xacro:include filename='none.xacro'/>", 2, "none.xacro.*cannot be read: No such file"),
        ("\n<xacro:include filename='bad.xacro'/>", 2, "bad.xacro.*is not XML"),
        ("\n<xacro:include filename='part.xacro'/>\n<xacro:part/>", 7, "part.xacro, line 7: .*'inside'"),
        ("\n<a b=\"${load_yaml('bad.yaml')}\"/>", 2, "bad.yaml: line 2: "),
        ("<a b=\"${load_yaml('')}\"/>", 1, r'load_yaml\(""\): cannot be read: it is a folder'),
        ("\n<xacro:property name='a b' value='1'/>", 2, "a name has letters, digits and _ only"),
        ("\n<xacro:property name='a' value='1' default='2'/>", 2, "one of value, default and remove"),
        ("\n<xacro:property name='a' value='1' scope='parent'/>", 2, "stands in no macro"),
        ("\n<xacro:property value='1'/>", 2, "<xacro:property>: the attribute 'name' is missing"),
        ("\n<xacro:macro name='m' params='a *b'/>\n<xacro:m/>", 3, "needs the block 'b'"),
        ("\n<xacro:macro name='m' params='a'/>\n<xacro:m/>", 3, "the macro m needs the parameter 'a'"),
        ("\n<xacro:macro name='m' params=''/>\n<xacro:m a='1'/>", 3, "the macro m has no parameter 'a'"),
        ("\n<xacro:macro name='m' params=''/>\n<xacro:m><x/></xacro:m>", 3, "the macro m has no use for <x>"),
        ("\n<xacro:macro name='m' params=\"a:='x\"/>", 2, "a quote is not closed"),
        ("\n<xacro:macro name='a.b' params=''/>", 2, "a macro is not called call, and has no dot"),
        ("\n<link a='${x'/>", 2, r'"\$\{x": \$ stands before'),
        ("\n<link a='$(env HOME)'/>", 2, "does not depend on where armctl runs; write the value"),
        ("\n<link a='$(none)'/>", 2, r"allowed are \$\(find PACKAGE\) and \$\(arg NAME\)"),
        ("\n<xacro:element xacro:name=''/>", 2, "its name is empty"),
        ("\n<a b=\"${xacro.fatal('the', 'reason')}\"/>", 2, "the file says: the reason"),
        ("<xacro:property name='a' value='${b}'/>\n<xacro:property name='b' value='${a}'/>\n<a b='${a}'/>", 3,
         "the properties are made of each other: a → b → a"),
    ],
)  # fmt: skip
def test_a_refusal_names_the_line(tmp_path: Path, content: str, line: int, says: str) -> None:
    part = '\n\n<xacro:macro name="part" params="">\n\n\n\n<a b="${inside}"/></xacro:macro>'
    others = {"bad.xacro": "<", "bad.yaml": "a: 1\n: - {", "part.xacro": part}
    file = write(tmp_path, {"arm.xacro": content, **others})
    with pytest.raises(RobotFileError, match=f"line {line}: .*") as refused:
        load_robot(file)
    assert refused.match(says)
    assert str(file) in str(refused.value) and "\n" not in str(refused.value)


def test_arguments_of_the_caller_go_before_the_defaults_of_the_file(tmp_path: Path) -> None:
    content = """<xacro:arg name="tool" default="tool0"/><xacro:property name="reach" value="1"/>
      <link name="base"/>"""
    file = write(tmp_path, {"arm.xacro": content + MACRO + CALLS.replace("tool0", "$(arg tool)")})
    assert "tool0" in read_urdf_file(UrdfSource.at(file)).links
    assert "gripper" in read_urdf_file(UrdfSource.at(file), {"tool": "gripper"}).links


# What may be run, and read.

WALK = (
    """[f for l in [[]] for _ in [l.append(g.gi_frame.f_back.f_back.f_back for g in l)] for f in l[0]][0]"""
)


def test_no_author_of_a_file_runs_code(tmp_path: Path) -> None:
    """The walk through frames that the package's filter of names lets pass, as a user loads the file."""
    owned = tmp_path / "owned"
    walk = f"${{{WALK}.f_builtins['open']('{owned}', 'w').name}}"
    content = f'<xacro:macro name="m" params="a"><link name="${{a}}"/></xacro:macro><xacro:m a="{walk}"/>'
    with pytest.raises(RobotFileError, match=r"line 1: .*cannot be computed"):
        load_robot(write(tmp_path, {"arm.xacro": content}))
    assert not owned.exists()


@pytest.mark.parametrize(
    "name",
    [
        "../outside/secret.xacro",
        "{outside}/secret.xacro",
        "link/secret.xacro",
        "linked.xacro",
        "$(find arm)/../outside/secret.xacro",
        "$(find outside)/secret.xacro",
        "file://{outside}/secret.xacro",
        "/proc/self/environ",
        "http://localhost/secret.xacro",
        "../outside/*.xacro",
        "fifo",
    ],
)
@pytest.mark.parametrize("reads", ["include", "load_yaml"])
@pytest.mark.parametrize("folder", ["package", "page"])
def test_no_file_outside_is_read(tmp_path: Path, name: str, reads: str, folder: str) -> None:
    outside = tmp_path / "outside"
    named = name.replace("{outside}", str(outside))
    use = (
        f'<xacro:include filename="{named}"/><link name="${{secret}}"/>'
        if reads == "include"
        else f"<link name=\"${{load_yaml('{named}').secret}}\"/>"
    )
    if folder == "page":
        place = install_package("arm.xacro", robot(use).encode(), tmp_path)
        file = place / "arm.xacro"
    else:
        file = write(tmp_path, {"arm/arm.xacro": use, "arm/package.xml": "<package/>"})
    (file.parent / "link").symlink_to(outside)
    (file.parent / "linked.xacro").symlink_to(outside / "secret.xacro")
    os.mkfifo(file.parent / "fifo")
    write(tmp_path, {"outside/secret.xacro": '<xacro:property name="secret" value="told"/>'})
    (outside / "secret.yaml").write_text("secret: told")
    with pytest.raises(RobotFileError, match="line 1: ") as refused:
        by_armctl(file)
    assert "told" not in str(refused.value)
    assert refused.match("leads out of the folder|no folder above|cannot be read: |holds no such|'secret'")


def test_links_to_the_files_of_a_package_lead_back_into_it(tmp_path: Path) -> None:
    """As a workspace of ROS has them, whose installed files are links to the sources."""
    source = write(tmp_path, {f"src/{name}": content for name, content in FILES["includes"].items()})
    installed = tmp_path / "install/share/my_arm"
    for name in FILES["includes"]:
        (installed / name).parent.mkdir(parents=True, exist_ok=True)
        (installed / name).symlink_to(tmp_path / "src" / name)
    assert by_armctl(installed / "arm.xacro") == by_armctl(source)


def test_a_package_that_only_a_simulator_needs_may_be_missing(tmp_path: Path) -> None:
    content = """<xacro:arg name="control" default="$(find my_gazebo)/c.yaml"/>
      <xacro:property name="mesh" value="$(find my_gazebo)/m"/>
      <gazebo><a>$(arg control)</a><b c="${mesh}"/></gazebo><ros2_control d="$(find my_gazebo)/${1 + 1}"/>
      <link name="a"/>"""
    _, _, _, inside = by_armctl(write(tmp_path, {"arm.xacro": content}))
    assert [one for one, _ in inside] == [
        ("gazebo", {}, "", []), ("ros2_control", {}, "", []), ("link", {"name": "a"}, "", []),
    ]  # fmt: skip
    with pytest.raises(RobotFileError, match=r"line 1: .*\$\(find my_gazebo\): no folder above"):
        by_armctl(write(tmp_path, {"arm.xacro": content.replace("gazebo>", "link>").replace("\n", "")}))


@pytest.mark.parametrize(
    "content",
    [
        '<gazebo><xacro:include filename="$(find nowhere)/x.xacro"/></gazebo>',
        "<gazebo><xacro:nothing/>${1 / 0}</gazebo>",
        "<ros2_control>${load_yaml('none.yaml').a}</ros2_control>",
        '<xacro:include filename="$(find my_gazebo)/urdf/arm.xacro"/><xacro:arm_gazebo tf="x"/>',
        '<xacro:include filename="a.ros2_control.xacro"/><xacro:an_ros2_control><b/></xacro:an_ros2_control>',
        '<xacro:include filename="$(find nowhere)/transmission.xacro"/>',
        """<xacro:macro name="m" params="file more:=$(find none)"><link name="m"/></xacro:macro>
           <xacro:m file="$(find my_controllers)/c.yaml"/>""",
    ],
)
def test_what_only_simulators_and_controllers_need_stops_nothing(tmp_path: Path, content: str) -> None:
    file = write(tmp_path, {"arm.xacro": f"{content}<link name='a'/>"})
    expanded = expand(parse_xml(file.read_bytes(), file), UrdfSource.at(file), {})
    assert [link.get("name") for link in expanded.root.findall("link")][-1] == "a"
    named = re.findall('filename="([^"]*)"', content) if "<gazebo" not in content else []
    assert list(expanded.left_out) == named


def test_a_package_that_the_arm_needs_is_named_where_a_macro_of_it_is_missing(tmp_path: Path) -> None:
    content = '<xacro:include filename="$(find my_control)/arm.xacro"/><xacro:arm/>'
    with pytest.raises(RobotFileError, match=r"<xacro:arm>: there is no such macro; .*my_control.*no folder"):
        load_robot(write(tmp_path, {"arm.xacro": content}))
    with pytest.raises(RobotFileError, match=r"\$\(find my_arm\): no folder above the file"):
        load_robot(write(tmp_path, {"arm.xacro": content.replace("my_control", "my_arm")}))


# Plain arms.

XACRO = """<robot name="my_arm" xmlns:xacro="http://www.ros.org/wiki/xacro">
  <xacro:arg name="height" default="0.1"/><xacro:arg name="unused"/>
  <xacro:property name="length" value="0.2"/>
  <xacro:property name="half" value="${length / 2}"/>
  <xacro:property name="count" value="2"/>
  <link name="base"/><link name="link${count - 1}"/><link name="tool0"/>
  <joint name="j" type="revolute">
    <parent link="base"/><child link="link1"/><axis xyz="0 0 1"/>
    <origin xyz="0 ${-half} $(arg height)" rpy="${pi/2} ${radians(30)} 0"/>
    <limit lower="${-pi}" upper="${2 * count * half * 10}" effort="-1" velocity="-1"/>
  </joint>
  <joint name="end" type="fixed"><parent link="link1"/><child link="tool0"/>
    <origin xyz="0 0 ${(length + half) * 2 ** count % 1}"/></joint>
</robot>"""


def test_an_arm_of_properties(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf.xacro").write_text(XACRO)
    robot = load_robot(tmp_path / "arm.urdf.xacro")
    assert robot.title == "my_arm"
    assert robot.limits == pytest.approx(np.array([[-math.pi, 4.0]]))
    assert robot.joints[0].stall_torque is None and robot.joints[0].speed == pytest.approx(math.radians(60))
    T = robot.forward([0.0])
    # Ry(30°) Rx(90°) of (0, 0, 0.2): (0, -0.2, 0)
    assert T[:3, 3] == pytest.approx([0, -0.1 - 0.2, 0.1], abs=1e-12)


def test_what_doubles_at_every_step_is_made_once(tmp_path: Path) -> None:
    names = [f"p{k}" for k in range(40)]
    pairs = itertools.pairwise(names)
    text = "".join(f'<xacro:property name="{b}" value="${{{a} + {a} - {a}}}"/>' for a, b in pairs)
    text += '<xacro:property name="p0" value="1"/><material name="${p39}"/>'
    (tmp_path / "arm.xacro").write_text(XACRO.replace("</robot>", f"{text}</robot>"))
    assert load_robot(tmp_path / "arm.xacro").n == 1


def test_packages_of_a_workspace_lie_in_repositories(tmp_path: Path) -> None:
    arm = '<xacro:include filename="$(find other)/x.xacro"/>'
    include = Step("turn", "revolute", "base", "hand").xml
    files = {
        "ws/src/mine/my_arm/urdf/arm.xacro": arm,
        "ws/src/mine/my_arm/package.xml": "<package><name>my_arm</name></package>",
        "ws/src/theirs/other/x.xacro": f'<link name="base"/><link name="hand"/>{include}',
    }
    file = write(tmp_path, files)
    with pytest.raises(RobotFileError, match=r"\$\(find other\): no folder above"):
        load_robot(file)  # a folder without a package.xml is none
    (tmp_path / "ws/src/theirs/other/package.xml").write_text("<package><name>other</name></package>")
    assert load_robot(file).n == 1

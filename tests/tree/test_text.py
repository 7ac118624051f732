import contextlib

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mercator_design.errors import FsmError
from mercator_design.modules.flavour import flavour_of
from mercator_design.tree.old_text import parse_old
from mercator_design.tree.text import parse, to_text
from mercator_design.tree.tree import Tree, TreeNode, action, condition
from tests.tree.maple import DATA

TEXT = (
    "--nroot 3 --nchildroot 2 --n0 0 --nchild0 2 --n00 6 --c00 0 --p00 0.5 --n01 5 --a01 0 --rwm01 5 --p01 0 "
    "--n1 0 --nchild1 2 --n10 6 --c10 3 --p10 3 --w10 2.5 --n11 5 --a11 4 --att11 2 --p11 0.25"
)
TREE = Tree(
    TreeNode(
        "sequence*",
        (
            TreeNode("selector", (condition("black floor", 0.5), action("exploration", 5.0))),
            TreeNode("selector", (condition("neighbours count", 3.0, 2.5), action("attraction", 2.0, p=0.25))),
        ),
    )
)


def test_text_both_ways():
    assert parse(TEXT) == TREE
    assert to_text(TREE) == TEXT
    assert parse(f"  --bt-config {TEXT}\n") == TREE


def test_every_kind_of_node():
    text = (
        "--nroot 0 --nchildroot 4 --n0 1 --nchild0 1 --n00 4 --nchild00 1 --n000 6 --c000 8 --p000 0.5 --d000 0.1 "
        "--n1 2 --nchild1 2 --n10 5 --a10 8 --r10 0.2 --p10 1 --n11 6 --c11 7 --p11 0.3 --n2 5 --a2 6 --p2 0.125 "
        "--n3 3 --nchild3 1 --n30 5 --a30 7 --p30 0"
    )
    assert to_text(parse(text)) == text
    kinds = [node.kind for _, node in parse(text).preorder]
    assert kinds == [
        "selector", "selector*", "negation", "condition", "sequence", "action", "condition", "action", "sequence*",
        "action",
    ]  # fmt: skip


def test_parameters_of_a_leaf_may_have_any_order():
    assert parse(TEXT.replace("--rwm01 5 --p01 0", "--p01 0 --rwm01 5")) == TREE


def changed(old, new):
    assert old in TEXT, old
    return TEXT.replace(old, new)


CHILDREN = " ".join(f"--n{i} 5 --a{i} 1 --p{i} 0" for i in range(11))
SIX_DIGITS = "--nroot 0 --nchildroot 1 " + " ".join(
    f"--n{'0' * depth} 0 --nchild{'0' * depth} 1" for depth in range(1, 6)
)

# What the original builder does with each: None if it does not build a tree, else a text that means what it builds.
CASES = {
    "no root": (changed("--nroot 3 ", ""), "expected --nroot, the kind of the root; found --nchildroot", None),
    "empty": ("", "expected --nroot, the kind of the root; found the end of the text", None),
    "blank": (" \n", "expected --nroot, the kind of the root; found the end of the text", None),
    "root is an action": (
        changed("--nroot 3", "--nroot 5"),
        "--nroot, the kind of the root: expected .* found 5",
        None,
    ),
    "root is a condition": (changed("--nroot 3", "--nroot 6"), "--nroot, .*: expected .* found 6", None),
    "unknown kind": (changed("--n0 0", "--n0 7"), "--n0, the kind of node 0: expected .* found 7", None),
    "kind is no number": (changed("--n0 0", "--n0 x7"), "--n0, the kind of node 0: expected .* found x7", TEXT),
    "unknown action": (
        changed("--a01 0", "--a01 9"),
        "--a01, the behaviour of node 01: expected one of 0 exp.* 9",
        None,
    ),
    "unknown condition": (changed("--c00 0", "--c00 9"), "--c00, the condition of node 00: expected .* found 9", None),
    "a child is missing": (
        TEXT[: TEXT.index(" --n1 ")],
        "expected --n1, the kind of node 1; found the end of the text",
        None,
    ),
    "number of children not next": (
        changed("--nroot 3 --nchildroot 2", "--nroot 3 --n9 1 --nchildroot 2"),
        "expected --nchildroot, the number of children of the root, a sequence*; found --n9",
        None,
    ),
    "number of children missing": (
        changed("--nchild0 2 ", ""),
        "expected --nchild0, the number of children of node 0, a selector; found --n00",
        None,
    ),
    "no children": (
        "--nroot 3 --nchildroot 0",
        "--nchildroot, .*: expected a whole number from 1 to 10, found 0",
        "same",
    ),
    "inner node without children": (
        "--nroot 3 --nchildroot 1 --n0 0 --nchild0 0",
        "--nchild0, the number of children of node 0, a selector: expected a whole number from 1 to 10, found 0",
        "same",
    ),
    "negation without a child": ("--nroot 4 --nchildroot 0", "--nchildroot, .*: expected 1, found 0", None),
    "negation of two": (
        "--nroot 4 --nchildroot 2 --n0 5 --a0 1 --p0 0 --n1 5 --a1 1 --p1 0",
        "--nchildroot, the number of children of the root, a negation: expected 1, found 2",
        None,
    ),
    "surplus children": (
        changed("--nchildroot 2", "--nchildroot 1"),
        "--n1 is not expected here: --nchildroot 1 ends before it",
        TEXT[: TEXT.index(" --n1 ")].replace("--nchildroot 2", "--nchildroot 1"),
    ),
    "surplus children below": (
        changed("--nchild0 2", "--nchild0 1"),
        "expected --n1, the kind of node 1; found --n01",
        "--nroot 3 --nchildroot 2 --n0 0 --nchild0 1 --n00 6 --c00 0 --p00 0.5 " + TEXT[TEXT.index("--n1 ") :],
    ),
    "parameter missing": (changed("--rwm01 5 ", ""), "node 01: --rwm01, the tau of exploration, is missing", None),
    "p of an action missing": (changed(" --p01 0 ", " "), "node 01: --p01, the p of exploration, is missing", None),
    "parameter twice": (changed("--rwm01 5", "--rwm01 5 --rwm01 7"), "--rwm01 is given twice", TEXT),
    "p of an action twice": (changed("--p01 0", "--p01 0 --p01 0.5"), "--p01 is given twice", TEXT),
    "node twice": (changed("--n00 6", "--n00 6 --n00 5"), "--n00 is given twice", TEXT),
    "parameter of another module": (
        changed("--rwm01 5", "--rwm01 5 --att01 2"),
        "node 01: exploration has no parameter --att01",
        TEXT,
    ),
    "parameter of no module": (
        changed("--rwm01 5", "--rwm01 5 --zzz01 2"),
        "expected a flag such as .* '--zzz01'",
        TEXT,
    ),
    "siblings not in order": (
        "--nroot 0 --nchildroot 2 --n1 5 --a1 1 --p1 0 --n0 5 --a0 1 --p0 0",
        "expected --n0, the kind of node 0; found --n1",
        None,
    ),
    "parameters before the action": (
        changed("--a01 0 --rwm01 5", "--rwm01 5 --a01 0"),
        "expected --a01, the behaviour of node 01; found --rwm01",
        None,
    ),
    "parameters before the condition": (
        changed("--c00 0 --p00 0.5", "--p00 0.5 --c00 0"),
        "expected --c00, the condition of node 00; found --p00",
        None,
    ),
    "p above 1": (
        changed("--p00 0.5", "--p00 1.5"),
        "node 00: --p00, .*: expected a number from 0 to 1, found 1.5",
        "same",
    ),
    "p below 0": (changed("--p01 0", "--p01 -0.1"), "node 01: --p01, the p of exploration: .* found -0.1", "same"),
    "comma": (changed("--p00 0.5", "--p00 0,5"), "node 00: --p00: expected a number .* found '0,5'", "0"),
    "no number": (changed("--p00 0.5", "--p00 half"), "node 00: --p00: expected a number .* found 'half'", "0"),
    "not a number": (changed("--p00 0.5", "--p00 nan"), "node 00: --p00: expected a number .* found 'nan'", None),
    "infinite": (changed("--att11 2", "--att11 inf"), "node 11: --att11: expected a number .* found 'inf'", None),
    "alpha below 1": (
        changed("--att11 2", "--att11 0.5"),
        "node 11: --att11, .*: expected .* 1 to 5, found 0.5",
        "same",
    ),
    "xi not whole": (
        changed("--p10 3", "--p10 3.7"),
        "node 10: --p10: expected an integer from 0 to 10, found '3.7'",
        TEXT,
    ),
    "xi of more than eight bits": (
        changed("--p10 3", "--p10 256"),
        "node 10: --p10, the xi of neighbours count: expected an integer from 0 to 10, found 256",
        changed("--p10 3", "--p10 0"),
    ),
    "eleven children": (
        f"--nroot 0 --nchildroot 11 {CHILDREN}",
        "--nchildroot, .*: expected a whole number from 1 to 10, found 11",
        "same",
    ),
    "eleven children, of which two have one identifier": (
        f"--nroot 0 --nchildroot 11 {CHILDREN}".replace(
            "--n1 5 --a1 1 --p1 0", "--n1 0 --nchild1 1 --n10 5 --a10 1 --p10 0"
        ),
        "--n10 is given twice",
        None,
    ),
    "identifier of six digits": (
        f"{SIX_DIGITS} --n000000 5 --a000000 1 --p000000 0",
        "node 000000: expected an identifier of at most 5 digits",
        None,
    ),
    "value missing": (TEXT.removesuffix(" 0.25"), "--p11: expected a value, found 'the end of the text'", None),
    "flag for a value": (changed("--a01 0", "--a01"), "--a01: expected a value, found '--rwm01'", TEXT),
    "the form of 2018": (
        "--rootnode 0 --nchildsroot 1 --n0 0 --nc0 1 --c0x0 0 --p0x0 0.5 --a0 0 --rwm0 5",
        "--rootnode: this is the form of trees of 2018; accept it .--lenient. to convert it",
        TEXT[: TEXT.index(" --n1 ")].replace("--nchildroot 2", "--nchildroot 1"),
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_strict(case):
    text, message, _ = CASES[case]
    with pytest.raises(FsmError, match=f"^{message.replace('*;', '.;')}"):
        parse(text)


@pytest.mark.parametrize("case", CASES)
def test_tolerant_as_the_original(case):
    """What the original refuses or crashes on stays an error; the rest is told, and means what the original makes."""
    text, _, meaning = CASES[case]
    told = []
    if meaning is None:
        with pytest.raises(FsmError):
            parse(text, tolerate=told.append)
        return
    tree = parse(text, tolerate=told.append)
    assert told
    if meaning == "same":
        assert to_text(tree) == " ".join(text.split())
    elif meaning == "0":
        assert tree == parse(changed("--p00 0.5", "--p00 0"))
    else:
        assert tree == parse(meaning)


def test_a_text_of_another_flavour_is_named(own_flavour):
    own_flavour("small", behaviours={"stop": 1}, conditions={"black floor": 0}, not_designed=())
    with pytest.raises(FsmError, match="found '--rwm0'; it fits the flavour maple"):
        parse("--nroot 0 --nchildroot 1 --n0 5 --a0 0 --rwm0 5 --p0 0", "small")


def test_other_architectures_flavours_are_refused():
    with pytest.raises(FsmError, match=r"flavour: expected one of trees .*maple.* found 'watermelon'"):
        parse("--nroot 0 --nchildroot 1 --n0 5 --a0 1 --p0 0", "watermelon")


def test_no_parameter_has_a_flag_of_trees():
    """The flags p, n, nchild, a and c have a meaning in texts of trees."""
    own = {flag for module in flavour_of("maple").modules for flag in [one.flag for one in module.parameters]}
    assert own.isdisjoint({"n", "nchild", "a", "c"})


class TestOldForm:
    TEXT = (
        "--rootnode 0 --nchildsroot 2 --n0 0 --nc0 2 --c0x0 0 --p0x0 0.5 --c0x1 3 --p0x1 4 --w0x1 1.5 --a0 0 --rwm0 7 "
        "--n1 0 --nc1 1 --c1x0 5 --p1x0 0.1 --a1 1"
    )

    def test_it_is_converted(self):
        assert to_text(parse_old(self.TEXT)) == (
            "--nroot 3 --nchildroot 2 --n0 0 --nchild0 3 --n00 6 --c00 0 --p00 0.5 --n01 6 --c01 3 --p01 4 --w01 1.5 "
            "--n02 5 --a02 0 --rwm02 7 --p02 0 --n1 0 --nchild1 2 --n10 6 --c10 5 --p10 0.1 --n11 5 --a11 1 --p11 0"
        )

    @pytest.mark.parametrize(
        ("old", "new", "message"),
        [
            ("--rootnode 0", "--rootnode 3", "--rootnode, the kind of the root: expected 0, found 3"),
            ("--nchildsroot 2", "--nchildsroot 3", "expected --n2, the kind of branch 2; found the end of the text"),
            ("--nchildsroot 2", "--nchildsroot 1", "--n1 is not expected here: --nchildsroot 1 ends with branch 0"),
            ("--n1 0", "--n1 2", "--n1, the kind of branch 1: expected 0, found 2"),
            ("--nc1 1", "--nc1 0", "--nc1, the number of conditions of branch 1: expected .* 1 to 9, found 0"),
            ("--p0x1 4 ", "", "branch 0, condition 1: --p0x1, the xi of neighbours count, is missing"),
            ("--a1 1", "--a1 99", "--a1, the action of branch 1: expected one of 0 exploration"),
            ("--a1 1", "--a1 1 --p1 0", "expected a flag such as"),
            ("--rwm0 7", "--rwm0 700", "branch 0: --rwm0, the tau of exploration: expected an integer from 0 to 100"),
        ],
    )
    def test_mistakes_have_a_place(self, old, new, message):
        assert old in self.TEXT
        with pytest.raises(FsmError, match=f"^{message}"):
            parse_old(self.TEXT.replace(old, new))


TOKENS = sorted({token for vector in DATA["vectors"] for token in vector["tree"].split()} | {"--rootnode", "-1", "nan"})


@settings(max_examples=300, deadline=None)
@given(st.data())
def test_no_text_leads_to_another_error(data):
    """Tokens of trees in another order, dropped, doubled and changed."""
    tokens = data.draw(st.sampled_from(DATA["vectors"]))["tree"].split()
    for _ in range(data.draw(st.integers(1, 4))):
        k = data.draw(st.integers(0, len(tokens) - 1))
        tokens[k : k + data.draw(st.integers(0, 2))] = data.draw(st.lists(st.sampled_from(TOKENS), max_size=2))
        tokens = tokens or [""]
    text = " ".join(tokens)
    for tolerate in (None, lambda _: None):
        with contextlib.suppress(FsmError):
            tree = parse(text, tolerate=tolerate)
            tree.program()
            again = parse(to_text(tree), tolerate=tolerate)
            assert again == tree

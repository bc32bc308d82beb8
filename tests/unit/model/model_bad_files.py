"""Files that must be rejected: name -> (text, every problem as "line: message")."""

WAYS = (
    "A link is described by flexural_rigidity and mass_per_length, by material and section, "
    "or by table."
)

BAD_ARMS = {
    "wrong values in several links": (
        """\
flexarm: 1
arm:
  gravity: [0, -9,81]
  theory: cubic
  links:
    - {length: 1, flexural_rigidity: 70e9, mass_per_length: 0.6}
    - length: -1.5
      flexural_rigidity: '105'
      mass_per_length: .nan
      elements: 0
  joints:
    - {damping: -0.1}
""",
        [
            (
                "3: arm.gravity must be a list of two numbers, got [0, -9, 81]. "
                "Gravity that pulls down is [0, -9.81]."
            ),
            "4: arm.theory must be one of 'linear', 'second_order', got 'cubic'.",
            "7: arm.links[1].length must be greater than 0, got -1.5.",
            (
                "8: arm.links[1].flexural_rigidity must be a number, got '105'. "
                "Write the bare number, in SI units."
            ),
            "9: arm.links[1].mass_per_length must be a finite number, got nan.",
            "10: arm.links[1].elements must be at least 1, got 0.",
            "11: arm.joints must have length 2, one joint for each link, got 1.",
            "12: arm.joints[0].damping must be at least 0, got -0.1.",
        ],
    ),
    "unknown keys suggest the nearest": (
        """\
flexarm: 1
arn: {}
arm:
  payloads: {mass: 1}
  links:
    - lenght: 1
      EI: 105
      mass_per_length: 1
      colour: red
""",
        [
            "2: arn is not a known key. Did you mean 'arm'?",
            "4: arm.payloads is not a known key. Did you mean 'payload'?",
            "6: arm.links[0].length is missing.",
            "6: arm.links[0].lenght is not a known key. Did you mean 'length'?",
            (
                "6: arm.links[0].flexural_rigidity is missing. Only a rigid link "
                "(flexible: false) does not need it."
            ),
            ("7: arm.links[0].EI is not a known key. Did you mean 'flexural_rigidity'?"),
            (
                "9: arm.links[0].colour is not a known key. Known: length, parent, "
                "parent_station, hub_radius, flexural_rigidity, mass_per_length, "
                "rotary_inertia_per_length, shear_rigidity, material, section, table, element, "
                "elements, segments, modes, flexible, rotary_inertia, damping, gauges."
            ),
        ],
    ),
    "keys given twice": (
        """\
flexarm: 1
arm:
  links:
    - {length: 1, flexural_rigidity: 1, mass_per_length: 1}
  gravity: [0, 0]
  links: []
""",
        ["6: arm.links is a duplicate key, first given in line 3."],
    ),
    "faults behind an anchor are told where they stand": (
        """\
flexarm: 1
arm:
  links:
    - &first
      length: 0
      flexural_rigidity: 1
      mass_per_length: 1
    - <<: *first
      mass_per_length: -1
    - *first
""",
        [
            "5: arm.links[0].length must be greater than 0, got 0.",
            "5: arm.links[1].length must be greater than 0, got 0.",
            "5: arm.links[2].length must be greater than 0, got 0.",
            "9: arm.links[1].mass_per_length must be at least 0, got -1.",
        ],
    ),
    "sections, tables, gauges, damping": (
        """\
flexarm: 1
arm:
  links:
    - length: 1
      material: stel
      section:
        kind: tube
        outer_diameter: 0.02
        thickness: 0.02
    - length: 2
      table:
        x: [0, 1.0, 0.5]
        mass_per_length: [1, 1]
        flexural_rigidity: [1, 1,
          0]
      damping: {kind: modal, ratio: 3}
    - length: 2
      mass_per_length: 1
      flexural_rigidity: 1
      modes: 9
      gauges:
        - {station: 0.1, distance: 0.01}
        - station: 2.1
          distance: 0.01
    - {length: 1, section: {kind: I-beam}, material: {density: 1}}
""",
        [
            (
                "5: arm.links[0].material must be density and youngs_modulus, or the name of a "
                "preset, got 'stel'. Did you mean 'steel'?"
            ),
            (
                "9: arm.links[0].section.thickness must be less than 0.01 (half of "
                "outer_diameter), got 0.02. The wall fills the section."
            ),
            ("12: arm.links[1].table.x[2] must be greater than the previous point (1.0), got 0.5."),
            (
                "13: arm.links[1].table.mass_per_length must have length 3, one value for each "
                "point of x, got 2."
            ),
            "15: arm.links[1].table.flexural_rigidity[2] must be greater than 0, got 0.",
            (
                "16: arm.links[1].damping.ratio must be at most 1, got 3. "
                "A ratio is a fraction: 0.01 is one per cent of critical damping."
            ),
            (
                "20: arm.links[2].modes must be at most 8 (twice the number of elements of a "
                "segment), got 9. Use more elements, or fewer modes."
            ),
            (
                "23: arm.links[2].gauges[1].station must be at most 2 (the length of the link), "
                "got 2.1."
            ),
            "25: arm.links[3].material.youngs_modulus is missing.",
            (
                "25: arm.links[3].section.kind must be one of 'rectangle', 'circle', 'tube', "
                "'box', got 'I-beam'."
            ),
        ],
    ),
    "links that shear": (
        """\
flexarm: 1
arm:
  links:
    - {length: 1, flexural_rigidity: 1, mass_per_length: 1, element: timoshenko}
    - length: 1
      flexural_rigidity: 1
      mass_per_length: 1
      kGA: 1
    - length: 1
      flexural_rigidity: 1
      mass_per_length: 1
      shear_rigidity: 5
    - length: 1
      element: timoshenko
      table:
        x: [0, 1]
        mass_per_length: [1, 1]
        flexural_rigidity: [1, 1]
        shear_rigidity: [1, 0]
    - length: 1
      material: {density: 1, youngs_modulus: 1, poissons_ratio: 0.6}
      section: {kind: circle, diameter: 0.1}
      element: timoshenco
""",
        [
            (
                "4: arm.links[0].shear_rigidity is missing. It is k G A. A material "
                "and a section define it, too."
            ),
            ("8: arm.links[1].kGA is not a known key. Did you mean 'shear_rigidity'?"),
            (
                "12: arm.links[2].shear_rigidity is not supported for an Euler-Bernoulli "
                "link. For shear deformation use element: timoshenko."
            ),
            "19: arm.links[3].table.shear_rigidity[1] must be greater than 0, got 0.",
            "21: arm.links[4].material.poissons_ratio must be at most 0.5, got 0.6.",
            (
                "23: arm.links[4].element must be one of 'euler_bernoulli', 'timoshenko', "
                "got 'timoshenco'. Did you mean 'timoshenko'?"
            ),
        ],
    ),
    "YAML 1.1 surprises": (
        """\
flexarm: 1
arm:
  links:
    - {length: 1:30, flexural_rigidity: 1_000, mass_per_length: 1, flexible: yes}
    - {length: 1.0.0, flexural_rigidity: 1,5, mass_per_length: 1}
""",
        [
            (
                "4: arm.links[0].length must be a number, got '1:30'. "
                "Write the bare number, in SI units."
            ),
            (
                "4: arm.links[0].flexural_rigidity must be a number, got '1_000'. "
                "Write the bare number, in SI units."
            ),
            "4: arm.links[0].flexible must be true or false, got 'yes'.",
            (
                "5: arm.links[1].length must be a number, got '1.0.0'. "
                "Write the bare number, in SI units."
            ),
            (
                "5: arm.links[1].5 is not a known key. Known: length, parent, "
                "parent_station, hub_radius, flexural_rigidity, mass_per_length, "
                "rotary_inertia_per_length, shear_rigidity, material, section, table, element, "
                "elements, segments, modes, flexible, rotary_inertia, damping, gauges."
            ),
        ],
    ),
    "tags and strange keys": (
        """\
flexarm: 1
arm:
  gravity: !!python/tuple [0, 0]
  links:
    - {length: !metres 1, flexural_rigidity: 1, mass_per_length: 1, [1, 2]: 3}
""",
        [
            "3: arm.gravity has the tag 'python/tuple'; tags are not supported.",
            "5: arm.links[0] has a list or a mapping as a key.",
            "5: arm.links[0].length has the tag '!metres'; tags are not supported.",
            (
                "5: arm.links[0].length must be a number, got '1'. "
                "Write the bare number, in SI units."
            ),
        ],
    ),
    "no links": ("flexarm: 1\narm: {}\n", ["2: arm.links is missing."]),
    "empty links": (
        "flexarm: 1\narm:\n  links: []\n",
        ["3: arm.links must have 1 to 256 entries, got 0."],
    ),
    "too many links": (
        f"flexarm: 1\narm:\n  links: [{', '.join(['{}'] * 300)}]\n",
        None,  # each link has its own problems; the test checks their number
    ),
    "links are no list": (
        "flexarm: 1\narm:\n  links: {length: 1}\n",
        ["3: arm.links must be a list, got {'length': 1}."],
    ),
    "a link is no mapping": (
        "flexarm: 1\narm:\n  links:\n    - length\n    -\n",
        [
            "4: arm.links[0] must be a mapping of keys to values, got 'length'.",
            "5: arm.links[1] must be a mapping of keys to values, got nothing.",
        ],
    ),
    "arm is no mapping": (
        "flexarm: 1\n\narm: 3\n",
        ["3: arm must be a mapping of keys to values, got 3."],
    ),
    "arm is nothing": (
        "flexarm: 1\narm:\n",
        ["2: arm must be a mapping of keys to values, got nothing."],
    ),
    "no arm": ("flexarm: 1\n", ["1: arm is missing."]),
    "no version": (
        "arm:\n  links: [{length: 1, mass_per_length: 1, flexural_rigidity: 1}]\n",
        [("1: flexarm is missing. Start the file with `flexarm: 1`, the version of its format.")],
    ),
    "later version": (
        "flexarm: 2\narm: {links: [{length: 1, mass_per_length: 1, flexural_rigidity: 1}]}\n",
        [
            (
                "1: flexarm must be 1 (the version of the file format), got 2. "
                "The file is for a newer flexarm: upgrade flexarm."
            )
        ],
    ),
    "version is true": (
        "flexarm: true\narm: {links: [{length: 1, mass_per_length: 1, flexural_rigidity: 1}]}\n",
        ["1: flexarm must be 1 (the version of the file format), got True."],
    ),
    "a list": ("- 1\n- 2\n", ["1: the file must be a mapping of keys to values, got [1, 2]."]),
    "a word": ("\narm\n", ["2: the file must be a mapping of keys to values, got 'arm'."]),
}

BROKEN_FILES = {
    "empty": (b"", ": the file is empty."),
    "only a comment": (b"# arm\n", ": the file is empty."),
    "tab": (b"flexarm: 1\narm:\n\tlinks: []\n", ":3: the file is not valid YAML: "),
    "open bracket": (b"flexarm: 1\narm: {links: [\n", ":3: the file is not valid YAML: "),
    "colon": (b"flexarm: 1\narm: links: 3\n", ":2: the file is not valid YAML: "),
    "two documents": (b"a: 1\n---\nb: 1\n", ":2: the file is not valid YAML: "),
    "undefined alias": (b"arm: *b\n", ":1: the file is not valid YAML: "),
    "binary": (b"\x7fELF\n\x02\xff\xfe", ":2: the file is not text in"),
    "null character": (b"a: 1\nb: \0\n", ":2: the file contains the character "),
    "latin-1": ("a: 1\nb: ä\n".encode("latin-1"), ":2: the file is not text in "),
    "UTF-16": ("flexarm: 1".encode("utf-16"), ":1: the file is not text in "),
    "deep lists": (b"[" * 5000, ": the file is nested too "),
    "deep blocks": (b"- " * 5000, ": the file is nested too"),
    "alias chain": (
        b"a0: &a0 []\n" + b"".join(b"a%d: &a%d [*a%d]\n" % (i, i, i - 1) for i in range(1, 3000)),
        None,  # deep through aliases, but wrong only because of its unknown keys
    ),
    "billion laughs": (
        b"a0: &a0 [1]\n"
        + b"".join(b"a%d: &a%d [%s]\n" % (i, i, b"*a%d, " % (i - 1) * 10) for i in range(1, 20)),
        ": the file has more than 2000000 values with its aliases expanded",
    ),
    "merges of merges": (
        b"a0: &a0 {x: 1}\n"
        + b"".join(
            b"a%d: &a%d {<<: [%s]}\n" % (i, i, b"*a%d, " % (i - 1) * 10) for i in range(1, 50)
        ),
        None,  # wrong only because of its unknown keys
    ),
    "merge of itself": (b"arm: &a {<<: {<<: *a}}\n", ": the file is nested too deeply"),
}

"""Program in C that runs an exported controller as the partner of `flexarm.realtime`."""

from __future__ import annotations

from flexarm.bridges.c_code.exported import Exported, origin
from flexarm.bridges.c_code.named_function import NamedFunction
from flexarm.real_time.packets import OTHER_TIME, REFERENCE, Layout

_PROGRAM = """\
#define _POSIX_C_SOURCE 200112L
#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <unistd.h>
#include "{name}.h"

#define HEAD 2
#define VALUES {values}
#define JOINTS {joints}
#define END (-1.0)

typedef unsigned char byte;

/* A double of a packet: 8 bytes, little-endian. */
static double read_double(const byte *from)
{{
    uint64_t bits = 0;
    double value;
    int k;
    for (k = 7; k >= 0; --k) {{
        bits = (bits << 8) | from[k];
    }}
    memcpy(&value, &bits, sizeof value);
    return value;
}}

static void write_double(double value, byte *to)
{{
    uint64_t bits;
    int k;
    memcpy(&bits, &value, sizeof bits);
    for (k = 0; k < 8; ++k) {{
        to[k] = (byte)(bits >> (8 * k));
    }}
}}
{memory}
/* Torques for the values of a packet. */
static void update(const double *values, double *torque)
{{
{calls}
}}

/* End the run, for a packet that does not fit; return the exit status. */
static int refuse(int sock, const struct sockaddr_storage *plant, socklen_t size)
{{
    byte answer[8 * HEAD] = {{0}};
    write_double(END, answer);
    sendto(sock, answer, sizeof answer, 0, (const struct sockaddr *)plant, size);
    return 1;
}}

/* Answer packets until the plant ends the run. */
static int serve(int sock)
{{
    static byte packet[8 * (HEAD + VALUES) + 1], answer[8 * (HEAD + JOINTS)];
    double values[VALUES], torque[JOINTS], last = END, h = {sample_time};
    struct sockaddr_storage plant;
    int k;
    for (;;) {{
        socklen_t size = sizeof plant;
        ssize_t count = recvfrom(sock, packet, sizeof packet, 0, (struct sockaddr *)&plant, &size);
        double number = count >= 8 ? read_double(packet) : NAN, time;
        if (count < 0) {{
            fprintf(stderr, "no packet before the time limit\\n");
            return 1;
        }}
        if (number == END) {{
            sendto(sock, packet, 8 * HEAD, 0, (struct sockaddr *)&plant, size);
            return 0;
        }}
        if (count != 8 * (HEAD + VALUES)) {{
            fprintf(stderr, "a packet has another length than %d bytes:\\n"
                "{layout}\\n", 8 * (HEAD + VALUES));
            return refuse(sock, &plant, size);
        }}
        if (number < last) {{
            continue; /* An old packet. */
        }}
        if (number > last) {{ /* Else its answer was lost: repeat it. */
            time = read_double(packet + 8);
            if (fabs(time - number * h) > {other_time} * h) {{
                fprintf(stderr, "packet %.0f has the time %g s, but the controller with its "
                    "sample time of %g s expects %g s\\n", number, time, h, number * h);
                return refuse(sock, &plant, size);
            }}
            for (k = 0; k < VALUES; ++k) {{
                values[k] = read_double(packet + 8 * (HEAD + k));
            }}
            update(values, torque);
            memcpy(answer, packet, 8 * HEAD);
            for (k = 0; k < JOINTS; ++k) {{
                write_double(torque[k], answer + 8 * (HEAD + k));
            }}
            last = number;
        }}
        sendto(sock, answer, sizeof answer, 0, (struct sockaddr *)&plant, size);
    }}
}}

int main(int argc, char **argv)
{{
    struct sockaddr_in own;
    struct timeval limit;
    int sock = socket(AF_INET, SOCK_DGRAM, 0), failed;
    if (argc < 2) {{
        fprintf(stderr, "usage: %s PORT [SECONDS]\\n", argv[0]);
        return 2;
    }}
    memset(&own, 0, sizeof own);
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    own.sin_port = htons((uint16_t)atoi(argv[1]));
    limit.tv_sec = argc > 2 ? atoi(argv[2]) : 10;
    limit.tv_usec = 0;
    setsockopt(sock, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    if (sock < 0 || bind(sock, (struct sockaddr *)&own, sizeof own) != 0) {{
        perror("cannot listen");
        return 1;
    }}
    failed = serve(sock);
    close(sock);
    return failed;
}}
"""


def packet_layout(export: Exported) -> Layout | None:
    """Return the layout of the packets of the plant; None if they lack an input of the controller.

    They contain the readings of exact sensors and, if the controller follows a reference, its
    values.
    """
    assert export.controller is not None
    joints, gauges = export.arm.joints, len(export.arm.gauges)
    sizes = {"joint_angle": joints, "joint_rate": joints}
    if gauges:
        sizes["strain"] = gauges
    needed = {name for function in export.controller.functions for name in function.inputs}
    if needed & REFERENCE.keys():
        sizes |= dict.fromkeys(REFERENCE, joints)
    if needed - sizes.keys() - export.controller.defaults.keys() - {"memory"}:
        return None
    return Layout({name: (size,) for name, size in sizes.items()})


def udp_program(export: Exported, layout: Layout) -> str:
    """Return the program for a layout of the packets of the plant."""
    assert export.controller is not None
    places, first = {}, 0
    for name, (size,) in layout.shapes.items():
        places[name] = f"values + {first}" if first else "values"
        first += size
    calls = {one.name: _call(export, one, places) for one in export.controller.functions}
    body, memory = [f"    {calls['controller_update']}"], ""
    if "controller_start" in calls:
        memory = f"\nstatic double memory[{export.macro('MEMORY')}];\n"
        body = ["    static int started = 0;", "    if (started) {", f"    {body[0]}"]
        body += [
            "    } else {",
            f"        {calls['controller_start']}",
            "    }",
            "    started = 1;",
        ]
    title = "controller over UDP, for POSIX systems"
    rules = f" *\n * Packets of the plant are little-endian doubles:\n * {layout}.\n"
    rules += " * Answers are sequence number, time, torques. The number -1 ends the run.\n */\n"
    filled = _PROGRAM.format(
        name=export.name,
        values=first,
        joints=export.macro("JOINTS"),
        sample_time=export.macro("SAMPLE_TIME"),
        other_time=OTHER_TIME,
        memory=memory,
        calls="\n".join(body),
        layout=str(layout),
    )
    return origin(f"{export.name}_udp.c", title) + rules + filled


def _call(export: Exported, function: NamedFunction, places: dict[str, str]) -> str:
    given = [places.get(name, "NULL") for name in function.inputs if name != "memory"]
    keeps = ["memory"] if "memory" in function.inputs or function.name.endswith("start") else []
    return f"{export.name}_{function.name}({', '.join([*given, *keeps, 'torque'])});"

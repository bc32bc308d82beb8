#include <arpa/inet.h>
#include <math.h>
#include <netinet/in.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/time.h>
#include <time.h>
#include <unistd.h>

#define END (-1.0)
#define START (-2.0)
#define REQUESTS 64

typedef unsigned char byte;

/* A double of a packet: 8 bytes, little-endian. */
static double read_double(const byte *from)
{
    uint64_t bits = 0;
    double value;
    int k;
    for (k = 7; k >= 0; --k) {
        bits = (bits << 8) | from[k];
    }
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void write_double(double value, byte *to)
{
    uint64_t bits;
    int k;
    memcpy(&bits, &value, sizeof bits);
    for (k = 0; k < 8; ++k) {
        to[k] = (byte)(bits >> (8 * k));
    }
}

/* A random whole number greater than zero; zero if the system has none. */
static double new_token(void)
{
    byte bytes[TOKEN_BYTES];
    double token = 0.0;
    size_t k, count = 0;
    FILE *source = fopen("/dev/urandom", "rb");
    if (source != NULL) {
        count = fread(bytes, 1, sizeof bytes, source);
        fclose(source);
    }
    if (count < sizeof bytes) {
        return 0.0;
    }
    for (k = 0; k < sizeof bytes; ++k) {
        token = 256.0 * token + bytes[k];
    }
    return token + 1.0;
}

/* Seconds of a clock that is never set. */
static double seconds(void)
{
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

/* Send a packet without values. */
static void send_head(int sock, const struct sockaddr_storage *plant, socklen_t size,
    double token, double number, double time)
{
    byte head[8 * HEAD];
    write_double(token, head);
    write_double(number, head + 8);
    write_double(time, head + 16);
    sendto(sock, head, sizeof head, 0, (const struct sockaddr *)plant, size);
}

/* Answer a packet of the run, unless it is older than another one.
   Return the number of bytes of the answer, or -1 for a packet that does not fit. */
static int answer_packet(const byte *packet, ssize_t count, byte *answer)
{
    static double last = END;
    double values[VALUES], torque[JOINTS], h = SAMPLE_TIME;
    double number = read_double(packet + 8), time = read_double(packet + 16);
    int k;
    if (count != 8 * (HEAD + VALUES)) {
        fprintf(stderr, "a packet has another length than %d bytes:\n"
            LAYOUT "\n", 8 * (HEAD + VALUES));
        return -1;
    }
    if (number > last) { /* Else its answer was lost, and is repeated. */
        if (fabs(time - number * h) > OTHER_TIME * h) {
            fprintf(stderr, "packet %.0f has the time %g s, but the controller with its "
                "sample time of %g s expects %g s\n", number, time, h, number * h);
            return -1;
        }
        for (k = 0; k < VALUES; ++k) {
            values[k] = read_double(packet + 8 * (HEAD + k));
        }
        update(values, torque);
        memcpy(answer, packet, 8 * HEAD);
        for (k = 0; k < JOINTS; ++k) {
            write_double(torque[k], answer + 8 * (HEAD + k));
        }
        last = number;
    }
    return number == last ? 8 * (HEAD + JOINTS) : 0;
}

/* The requests for a run, the newest in place of the oldest, and the tokens that answer them. */
static double requests[REQUESTS], tokens[REQUESTS];
static int remembered = 0;

/* The token for a request. */
static double grant(double request)
{
    int k;
    for (k = 0; k < remembered && k < REQUESTS; ++k) {
        if (requests[k] == request) {
            return tokens[k];
        }
    }
    k = remembered++ % REQUESTS;
    requests[k] = request;
    return tokens[k] = new_token();
}

static int is_granted(double token)
{
    int k, found = 0;
    for (k = 0; k < remembered && k < REQUESTS; ++k) {
        found = found || (token > 0.0 && tokens[k] == token);
    }
    return found;
}

/* Answer packets until the plant ends the run, for at most `limit` seconds without one.
   The run begins with the first packet that has a token with which a request was answered. */
static int serve(int sock, double limit)
{
    static byte packet[8 * (HEAD + VALUES) + 1], answer[8 * (HEAD + JOINTS)];
    double run = 0.0, token, number, until = seconds() + limit;
    struct sockaddr_storage plant;
    int count;
    for (;;) {
        socklen_t size = sizeof plant;
        ssize_t length = recvfrom(sock, packet, sizeof packet, 0, (struct sockaddr *)&plant, &size);
        if (length < 0 || seconds() > until) {
            fprintf(stderr, "no packet before the time limit\n");
            return 1;
        }
        token = length < 8 * HEAD ? 0.0 : read_double(packet);
        number = read_double(packet + 8);
        if (run == 0.0 && is_granted(token)) {
            run = token;
        }
        if (run == 0.0 && token != 0.0 && number == START) {
            send_head(sock, &plant, size, token, START, grant(token));
            continue;
        }
        if (run == 0.0 || token != run) {
            continue; /* A packet of another program or of an earlier run. */
        }
        if (number == END) {
            send_head(sock, &plant, size, run, END, read_double(packet + 16));
            return 0;
        }
        count = answer_packet(packet, length, answer);
        if (count < 0) {
            send_head(sock, &plant, size, run, END, 0.0);
            return 1;
        }
        if (count > 0) {
            sendto(sock, answer, (size_t)count, 0, (struct sockaddr *)&plant, size);
        }
        until = seconds() + limit;
    }
}

int main(int argc, char **argv)
{
    struct sockaddr_in own;
    struct timeval limit;
    int sock = socket(AF_INET, SOCK_DGRAM, 0), failed;
    if (argc < 2) {
        fprintf(stderr, "usage: %s PORT [SECONDS]\n", argv[0]);
        return 2;
    }
    memset(&own, 0, sizeof own);
    own.sin_family = AF_INET;
    own.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    own.sin_port = htons((uint16_t)atoi(argv[1]));
    limit.tv_sec = argc > 2 ? atoi(argv[2]) : 10;
    limit.tv_usec = 0;
    setsockopt(sock, SOL_SOCKET, SO_RCVTIMEO, &limit, sizeof limit);
    if (sock < 0 || bind(sock, (struct sockaddr *)&own, sizeof own) != 0) {
        perror("cannot listen");
        return 1;
    }
    if (new_token() == 0.0) {
        fprintf(stderr, "no random numbers in /dev/urandom\n");
        return 1;
    }
    failed = serve(sock, (double)limit.tv_sec);
    close(sock);
    return failed;
}

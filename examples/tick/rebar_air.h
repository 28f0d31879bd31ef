/* A client of the bench in one file, C99 and POSIX alone: include it once in your agent (manifest: `air: tick`), link with -lm.

   The air network comes and goes as JSON in the lines of the tick socket; MAVLink goes over UDP and is read and written here as
   far as an agent needs it that flies by the autopilot's own modes. docs/agents-protocol.md describes both. */
#ifndef REBAR_AIR_H
#define REBAR_AIR_H
#ifndef _POSIX_C_SOURCE
#define _POSIX_C_SOURCE 200809L
#endif
#include <arpa/inet.h>
#include <math.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

enum { AIR_SYSTEM = 246, AIR_COMPONENT = 1, AIR_ARDUPILOT = 3 };
#define AIR_EARTH_M 6378137.0
#define AIR_RADIAN 0.017453292519943295

static inline void air_fail(const char *what) {
  perror(what);
  exit(1);
}

/* ---- JSON: a tree of values, which lives until the next tick. ---- */

typedef struct json {
  const char *key, *text;    /* text: of a string, else NULL */
  double number;             /* true is 1, null is not a number */
  struct json *first, *next; /* of an object or a list: its values */
} json;

static char *json_at;
static json *json_free;

static inline char *json_string(void) {
  char *start = ++json_at, *to = start;
  for (; *json_at && *json_at != '"'; json_at++) {
    if (*json_at != '\\') {
      *to++ = *json_at;
      continue;
    }
    const char *plain = "\"\\/bfnrt", *found = strchr(plain, *++json_at);
    unsigned code = 0, low = 0;
    if (found && *found) {
      *to++ = "\"\\/\b\f\n\r\t"[found - plain];
    } else if (sscanf(json_at, "u%4x", &code) == 1) {
      json_at += 4;
      if (code >> 10 == 0x36 && sscanf(json_at + 1, "\\u%4x", &low) == 1) { /* a pair of UTF-16 */
        code = 0x10000 + ((code & 0x3ff) << 10) + (low & 0x3ff);
        json_at += 6;
      }
      int more = code < 0x80 ? 0 : code < 0x800 ? 1 : code < 0x10000 ? 2 : 3;
      *to++ = (char)(more ? (0xf00 >> more & 0xff) | code >> 6 * more : code);
      while (more--) *to++ = (char)(0x80 | (code >> 6 * more & 0x3f));
    }
  }
  if (*json_at) json_at++;
  *to = 0;
  return start;
}

static inline json *json_value(void) {
  json *value = json_free++, **last = &value->first;
  memset(value, 0, sizeof *value);
  json_at += strspn(json_at, " \t\r\n,:");
  if (*json_at == '"') {
    value->text = json_string();
  } else if (*json_at == '{' || *json_at == '[') {
    int is_object = *json_at++ == '{';
    while (json_at += strspn(json_at, " \t\r\n,:"), *json_at && !strchr("]}", *json_at)) {
      const char *key = is_object ? json_string() : NULL;
      *last = json_value();
      (*last)->key = key;
      last = &(*last)->next;
    }
    if (*json_at) json_at++;
  } else {
    char *end = json_at;
    value->number = *json_at == 't' ? 1 : *json_at == 'f' ? 0 : *json_at == 'n' ? NAN : strtod(json_at, &end);
    json_at = end > json_at ? end : json_at + strcspn(json_at, ",]} \t\r\n");
  }
  return value;
}

/* The value in a text, which is changed. Ends what was read before. */
static inline json *json_read(char *text) {
  static json *values;
  size_t most = 2;
  for (const char *at = text; *at; at++) most += *at == ',' || *at == '[' || *at == '{';
  free(values);
  if (!(values = malloc(most * sizeof *values))) air_fail("no memory for a tick");
  json_at = text;
  json_free = values;
  return json_value();
}

static inline const json *json_get(const json *of, const char *key) {
  const json *value = of ? of->first : NULL;
  while (value && (!value->key || strcmp(value->key, key))) value = value->next;
  return value;
}

/* The first value of a list, for `for (item = json_list(...); item; item = item->next)`. */
static inline const json *json_list(const json *of, const char *key) {
  const json *list = json_get(of, key);
  return list ? list->first : NULL;
}

static inline double json_number(const json *of, const char *key) {
  const json *value = json_get(of, key);
  return value ? value->number : 0;
}

static inline const char *json_text(const json *of, const char *key) {
  const json *value = json_get(of, key);
  return value && value->text ? value->text : "";
}

/* ---- The session ---- */

typedef struct {
  double east_m, north_m;
} air_place;

/* A detection thrown onto flat ground. */
typedef struct {
  char class_label[32];
  double confidence, seen_s;
  air_place place;
  int frames; /* in which it was seen: 1 */
} air_thing;

typedef struct {
  double x, y, z, w;
} air_quaternion;

static struct {
  const char *vehicle_name, *options;
  double now_s;
  const json *messages;              /* of this tick: `topic` and `message` of each */
  int is_ready, is_armed, autopilot; /* of the vehicle, and where it is */
  double height_m, amsl_m, latitude_deg, longitude_deg;
  double origin_latitude_deg, origin_longitude_deg, origin_m; /* of the mission's map */
  int udp, tcp, has_peer;
  struct sockaddr_in peer;
  long received, sent, number;
  FILE *lines;
  char *line, *outbox;
  size_t line_size, outbox_size, outbox_used;
  char mount_frame[64];
  int has_pose, has_camera;
  air_quaternion mount, body;
  double body_east_m, body_north_m, body_up_m, k[9];
} air;

/* ---- MAVLink ---- */

static inline uint16_t air_crc(const uint8_t *data, size_t size) { /* CRC-16/MCRF4XX */
  uint16_t value = 0xffff;
  while (size--) {
    uint8_t low = (uint8_t)(*data++ ^ value);
    low ^= (uint8_t)(low << 4);
    value = (uint16_t)(value >> 8 ^ low << 8 ^ low << 3 ^ low >> 4);
  }
  return value;
}

static inline void air_put(uint8_t *to, uint32_t value, int bytes) {
  while (bytes--) *to++ = (uint8_t)value, value >>= 8;
}

static inline void air_put_float(uint8_t *to, double value) {
  float number = (float)value;
  uint32_t bits;
  memcpy(&bits, &number, 4);
  air_put(to, bits, 4);
}

static inline uint32_t air_word(const uint8_t *at) {
  return at[0] | (uint32_t)at[1] << 8 | (uint32_t)at[2] << 16 | (uint32_t)at[3] << 24;
}

/* `extra` is the extra byte of the checksum, from MAVLink's definition of the message. */
static inline void air_send(int message, uint8_t extra, const uint8_t *payload, size_t size) {
  uint8_t frame[280] = {0xfd, 0, 0, 0, (uint8_t)air.sent, AIR_SYSTEM, AIR_COMPONENT};
  if (!air.has_peer) return; /* nothing has come from it yet, so nobody knows where it listens */
  while (size > 1 && !payload[size - 1]) size--;
  frame[1] = (uint8_t)size;
  air_put(frame + 7, (uint32_t)message, 3);
  memcpy(frame + 10, payload, size);
  frame[10 + size] = extra;
  air_put(frame + 10 + size, air_crc(frame + 1, 10 + size), 2);
  sendto(air.udp, frame, 12 + size, 0, (struct sockaddr *)&air.peer, sizeof air.peer);
  air.sent++;
}

/* COMMAND_LONG */
static inline void air_command(int number, double p1, double p2, double p3, double p4, double p7) {
  uint8_t payload[33] = {0};
  double parameters[7] = {p1, p2, p3, p4, isnan(p4) ? NAN : 0, isnan(p4) ? NAN : 0, p7};
  for (int i = 0; i < 7; i++) air_put_float(payload + 4 * i, parameters[i]);
  air_put(payload + 28, (uint32_t)number, 2);
  payload[30] = payload[31] = 1;
  air_send(76, 152, payload, sizeof payload);
}

/* Once a second. */
static inline void air_heartbeat(void) {
  static const uint8_t payload[9] = {0, 0, 0, 0, 18, 8, 0, 4, 3};
  air_send(0, 50, payload, sizeof payload);
  if (air.autopilot == AIR_ARDUPILOT && air.amsl_m == 0) { /* it streams nothing of itself */
    air_command(511, 1, 1e6, 0, 0, 0);
    air_command(511, 33, 1e5, 0, 0, 0);
  }
}

static inline void air_arm(void) {
  if (air.autopilot == AIR_ARDUPILOT) air_command(176, 1, 4, 0, 0, 0); /* GUIDED */
  air_command(400, 1, 0, 0, 0, 0);
}

static inline void air_take_off(double height_m) {
  if (air.autopilot == AIR_ARDUPILOT)
    air_command(22, 0, 0, 0, 0, height_m);
  else
    air_command(22, NAN, 0, 0, NAN, air.amsl_m - air.height_m + height_m);
}

static inline void air_land(void) { air_command(21, 0, 0, 0, NAN, 0); }

/* Metres of a degree of latitude; on a sphere, a centimetre in a hundred metres is enough for a search. */
static inline double air_degree_m(void) { return (AIR_EARTH_M + air.origin_m) * AIR_RADIAN; }

/* DO_REPOSITION: the autopilot flies there by itself and stays. */
static inline void air_go_to(air_place goal, double height_m, double speed_mps) {
  uint8_t payload[35] = {0};
  double of_longitude_m = air_degree_m() * cos(air.origin_latitude_deg * AIR_RADIAN);
  double latitude_deg = air.origin_latitude_deg + goal.north_m / air_degree_m();
  double longitude_deg = air.origin_longitude_deg + goal.east_m / of_longitude_m;
  air_put_float(payload, speed_mps);
  air_put_float(payload + 4, 1);
  air_put_float(payload + 12, NAN);
  air_put(payload + 16, (uint32_t)(int32_t)lround(latitude_deg * 1e7), 4);
  air_put(payload + 20, (uint32_t)(int32_t)lround(longitude_deg * 1e7), 4);
  air_put_float(payload + 24, air.amsl_m - air.height_m + height_m);
  air_put(payload + 28, 192, 2);
  payload[30] = payload[31] = 1;
  air_send(75, 158, payload, sizeof payload);
}

/* Where the vehicle is, from the mission's origin. */
static inline air_place air_position(void) {
  air_place place;
  place.east_m = (air.longitude_deg - air.origin_longitude_deg) * air_degree_m() * cos(air.origin_latitude_deg * AIR_RADIAN);
  place.north_m = (air.latitude_deg - air.origin_latitude_deg) * air_degree_m();
  return place;
}

static inline void air_read_frame(const uint8_t *frame) {
  uint8_t payload[256] = {0}; /* MAVLink leaves out zeros at the end of a payload */
  memcpy(payload, frame + 10, frame[1]);
  switch (air_word(frame + 7) & 0xffffff) {
    case 0: /* HEARTBEAT, not of a ground station */
      if (payload[5] == 8) break;
      air.autopilot = payload[5];
      air.is_armed = payload[6] >> 7;
      break;
    case 1: /* SYS_STATUS: MAV_SYS_STATUS_PREARM_CHECK is healthy */
      air.is_ready = air_word(payload + 8) >> 28 & 1;
      break;
    case 33: /* GLOBAL_POSITION_INT */
      air.latitude_deg = (int32_t)air_word(payload + 4) * 1e-7;
      air.longitude_deg = (int32_t)air_word(payload + 8) * 1e-7;
      air.amsl_m = (int32_t)air_word(payload + 12) * 1e-3;
      air.height_m = (int32_t)air_word(payload + 16) * 1e-3;
  }
}

/* What has come. Lockstep states in each tick how many frames were sent since the start: all of them are waited for. */
static inline void air_receive(long count) {
  static uint8_t data[65536 + 280];
  struct pollfd ready = {air.udp, POLLIN, 0};
  while (poll(&ready, 1, air.received < count ? 10000 : 0) > 0) {
    socklen_t length = sizeof air.peer;
    ssize_t size = recvfrom(air.udp, data, 65536, 0, (struct sockaddr *)&air.peer, &length);
    air.has_peer = 1;
    for (ssize_t at = 0; at < size; air.received++) {
      air_read_frame(data + at);
      at += 12 + data[at + 1] + 13 * (data[at + 2] & 1); /* header, payload, checksum, a signature where there is one */
    }
  }
  if (air.received < count) air_fail("MAVLink frames are missing");
}

/* ---- Messages ---- */

static inline void air_add(const char *format, ...) {
  va_list words;
  va_start(words, format);
  size_t room = air.outbox_size - air.outbox_used;
  int length = vsnprintf(air.outbox + air.outbox_used, room, format, words);
  va_end(words);
  if ((size_t)length >= room) {
    air.outbox_size = 2 * (air.outbox_used + (size_t)length) + 4096;
    if (!(air.outbox = realloc(air.outbox, air.outbox_size))) air_fail("no memory for an answer");
    va_start(words, format);
    vsnprintf(air.outbox + air.outbox_used, (size_t)length + 1, format, words);
    va_end(words);
  }
  air.outbox_used += (size_t)length;
}

/* Publish a message under /VEHICLE/agent/: reports, decisions, status, tracks, answers, consent_requests. `air_add` its fields as
   in printf between the two, each with a comma before it. All messages go with the acknowledgement. */
static inline void air_begin(const char *topic) {
  air_add("%s{\"topic\":\"/%s/agent/%s\",\"message\":{\"time_s\":%.3f", air.outbox_used ? "," : "", air.vehicle_name, topic, air.now_s);
}

static inline void air_end(void) { air_add("}}"); }

static inline double air_apart(air_place a, air_place b) { return hypot(a.east_m - b.east_m, a.north_m - b.north_m); }

static inline air_place air_place_of(const json *of) {
  air_place place = {json_number(of, "east_m"), json_number(of, "north_m")};
  return place;
}

static inline int air_is(const char *topic, const char *end) {
  size_t length = strlen(topic), tail = strlen(end);
  return length >= tail && !strcmp(topic + length - tail, end);
}

/* Connect, and say which topics are read, NULL at the end: "mission" is /VEHICLE/mission, "/tf" itself. */
static inline void air_open(const char *agent, const char *const *topics) {
  struct sockaddr_in own = {.sin_family = AF_INET}, bench = {.sin_family = AF_INET};
  char host[64];
  int port, yes = 1;
  setvbuf(stdout, NULL, _IOLBF, 0);
  air.vehicle_name = getenv("REBAR_VEHICLE");
  air.options = getenv("REBAR_OPTIONS");
  if (!getenv("REBAR_MAVLINK") || !getenv("REBAR_TICK")) air_fail("the bench starts this program");
  sscanf(getenv("REBAR_MAVLINK"), "udpin:%63[^:]:%d", host, &port);
  own.sin_port = htons((uint16_t)port);
  inet_pton(AF_INET, host, &own.sin_addr);
  air.udp = socket(AF_INET, SOCK_DGRAM, 0);
  if (bind(air.udp, (struct sockaddr *)&own, sizeof own)) air_fail("MAVLink");
  sscanf(getenv("REBAR_TICK"), "%63[^:]:%d", host, &port);
  bench.sin_port = htons((uint16_t)port);
  inet_pton(AF_INET, host, &bench.sin_addr);
  air.tcp = socket(AF_INET, SOCK_STREAM, 0);
  if (connect(air.tcp, (struct sockaddr *)&bench, sizeof bench)) air_fail("tick socket");
  setsockopt(air.tcp, IPPROTO_TCP, TCP_NODELAY, &yes, sizeof yes);
  air.lines = fdopen(air.tcp, "r");
  dprintf(air.tcp, "{\"kind\":\"hello\",\"protocol\":1,\"agent\":\"%s\",\"secret\":\"%s\",\"subscribes\":[", agent, getenv("REBAR_TICK_SECRET"));
  for (int i = 0; topics[i]; i++)
    dprintf(air.tcp, "%s\"%s%s%s%s\"", i ? "," : "", *topics[i] == '/' ? "" : "/", *topics[i] == '/' ? "" : air.vehicle_name,
            *topics[i] == '/' ? "" : "/", topics[i]);
  dprintf(air.tcp, "]}\n");
}

/* The next tick: sets `air.now_s` and `air.messages`. 0 at the end of the session. */
static inline int air_tick(void) {
  if (getline(&air.line, &air.line_size, air.lines) < 0) return 0;
  const json *tick = json_read(air.line);
  if (!strcmp(json_text(tick, "kind"), "end")) {
    puts(json_text(tick, "reason"));
    return 0;
  }
  air.number = (long)json_number(tick, "number");
  air.now_s = json_number(tick, "time_ns") * 1e-9;
  air.messages = json_list(tick, "air");
  air_receive((long)json_number(json_get(tick, "links"), "onboard"));
  for (const json *item = air.messages; item; item = item->next)
    if (air_is(json_text(item, "topic"), "/mission")) {
      const json *origin = json_get(json_get(item, "message"), "origin");
      air.origin_latitude_deg = json_number(origin, "latitude_deg");
      air.origin_longitude_deg = json_number(origin, "longitude_deg");
      air.origin_m = json_number(origin, "altitude_m");
    }
  return 1;
}

/* Answer the tick, with all messages. In one piece: time stands still until it is there. */
static inline void air_ack(void) {
  char head[128];
  int length = snprintf(head, sizeof head, "{\"kind\":\"ack\",\"number\":%ld,\"links\":{\"onboard\":%ld},\"air\":[", air.number, air.sent);
  air_add("]}\n");
  if (write(air.tcp, head, (size_t)length) < 0) return; /* the session is over */
  for (size_t at = 0; at < air.outbox_used;) {
    ssize_t written = write(air.tcp, air.outbox + at, air.outbox_used - at);
    if (written < 0) return;
    at += (size_t)written;
  }
  air.outbox_used = 0;
}

/* ---- Geometry: pixel to ground ---- */

/* A vector turned by a quaternion as ROS writes it. */
static inline void air_turn(air_quaternion q, double v[3]) {
  double a = 2 * (q.y * v[2] - q.z * v[1]), b = 2 * (q.z * v[0] - q.x * v[2]), c = 2 * (q.x * v[1] - q.y * v[0]);
  v[0] += q.w * a + q.y * c - q.z * b;
  v[1] += q.w * b + q.z * a - q.x * c;
  v[2] += q.w * c + q.x * b - q.y * a;
}

static inline air_quaternion air_rotation(const json *transform) {
  const json *q = json_get(transform, "rotation");
  air_quaternion turn = {json_number(q, "x"), json_number(q, "y"), json_number(q, "z"), json_number(q, "w")};
  return turn;
}

/* Where a pixel of the main camera meets flat ground, by the latest pose and the camera's mount; 0 where it does not. */
static inline int air_ground(double x_px, double y_px, air_place *ground) {
  if (!air.has_pose || !air.has_camera) return 0;
  double ray[3] = {(x_px - air.k[2]) / air.k[0], (y_px - air.k[5]) / air.k[4], 1};
  air_turn(air.mount, ray);
  air_turn(air.body, ray);
  if (ray[2] > -0.05) return 0;
  ground->east_m = air.body_east_m + air.body_up_m / -ray[2] * ray[0];
  ground->north_m = air.body_north_m + air.body_up_m / -ray[2] * ray[1];
  return 1;
}

/* Take in a message; the objects on the ground, if it holds detections: at most `most` into `things`, and how many. */
static inline int air_see(const char *topic, const json *message, air_thing *things, int most) {
  int count = 0;
  const json *item = json_list(message, "transforms");
  if (!strcmp(topic, "/tf_static") && item) {
    snprintf(air.mount_frame, sizeof air.mount_frame, "%s", json_text(json_get(item, "header"), "frame_id"));
    air.mount = air_rotation(json_get(item, "transform"));
  }
  for (; item && !strcmp(topic, "/tf"); item = item->next) {
    const json *transform = json_get(item, "transform"), *at = json_get(transform, "translation");
    if (strcmp(json_text(item, "child_frame_id"), air.mount_frame)) continue;
    air.body = air_rotation(transform);
    air.body_east_m = json_number(at, "x");
    air.body_north_m = json_number(at, "y");
    air.body_up_m = json_number(at, "z");
    air.has_pose = 1;
  }
  if (air_is(topic, "/camera_info")) {
    int i = 0;
    for (item = json_list(message, "k"); item && i < 9; item = item->next) air.k[i++] = item->number;
    air.has_camera = 1;
  }
  if (!air_is(topic, "/detections")) return 0;
  for (item = json_list(message, "detections"); item && count < most; item = item->next) {
    const json *box = json_get(item, "bbox"), *at = json_get(json_get(box, "center"), "position");
    const json *best = json_get(json_list(item, "results"), "hypothesis");
    air_thing *thing = &things[count];
    /* The middle of the lower edge stands on the ground. */
    count += air_ground(json_number(at, "x"), json_number(at, "y") + json_number(box, "size_y") / 2, &thing->place);
    snprintf(thing->class_label, sizeof thing->class_label, "%s", json_text(best, "class_id"));
    thing->confidence = json_number(best, "score");
    thing->seen_s = air.now_s;
    thing->frames = 1;
  }
  return count;
}

#endif

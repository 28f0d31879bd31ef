/* An agent without a library: searches the reported places by the urgency of each, reports what it sees there, comes home. */
#include "rebar_air.h"

/* A sighting in three detections of one class within 15 m, none of them doubtful; who walks is elsewhere after 30 s. Chosen. */
enum { SIGHTINGS = 3, MOST = 512 };
static const double NEAR_M = 15, SCORE = 0.35, FORGET_S = 30;

typedef struct {
  char id[64], class_label[32];
  air_place place;
  double uncertainty_m, priority;
  int is_visited, is_reported;
} target;

static air_thing things[MOST];
static target targets[MOST];
static char bystanders[16][32];
static int thing_count, target_count, bystander_count, has_mission;
static air_place home;
static double altitude_m, speed_mps, no_mark_within_m, arrived_s, asked_s = -10, second_s = -10;
static const char *phase = "starting";

static int walks(const air_thing *thing) {
  for (int i = 0; i < bystander_count; i++)
    if (!strcmp(bystanders[i], thing->class_label)) return 1;
  return 0;
}

static void remember(const air_thing *seen) {
  air_thing *same = things;
  while (same < things + thing_count && (strcmp(same->class_label, seen->class_label) || air_apart(same->place, seen->place) >= NEAR_M)) same++;
  if (same == things + MOST || seen->confidence < SCORE) return;
  if (same == things + thing_count) things[thing_count++] = *seen, same->frames = 0;
  same->frames++; /* and the mean of all sightings */
  same->place.east_m += (seen->place.east_m - same->place.east_m) / same->frames;
  same->place.north_m += (seen->place.north_m - same->place.north_m) / same->frames;
  same->confidence = fmax(same->confidence, seen->confidence), same->seen_s = air.now_s;
}

static void take_in(const char *topic, const json *message) {
  air_thing seen[MOST];
  if (air_is(topic, "/mission")) {
    has_mission = 1, home = air_place_of(json_get(message, "home")), altitude_m = json_number(message, "altitude_m");
    speed_mps = json_number(message, "speed_mps"), no_mark_within_m = json_number(message, "no_mark_within_m");
    for (const json *item = json_list(message, "bystander_classes"); item && bystander_count < 16; item = item->next)
      snprintf(bystanders[bystander_count++], 32, "%s", item->text);
  } else if (air_is(topic, "/intelligence") && target_count < MOST) {
    target *told = &targets[target_count++];
    snprintf(told->id, sizeof told->id, "%s", json_text(message, "id"));
    snprintf(told->class_label, sizeof told->class_label, "%s", json_text(message, "class_label"));
    told->place = air_place_of(message), told->uncertainty_m = json_number(message, "uncertainty_m"), told->priority = json_number(message, "priority");
  } else if (air_is(topic, "/orders")) {
    air_begin("answers");
    air_add(",\"order\":\"%s\",\"accepted\":false,\"reason\":\"this agent knows no orders yet\"", json_text(message, "id"));
    air_end();
  }
  for (int i = 0, count = air_see(topic, message, seen, MOST); i < count; i++) remember(&seen[i]);
}

static void report(target *told, const air_thing *found) {
  int near = 0;
  if (told->is_reported || strcmp(found->class_label, told->class_label) || found->frames < SIGHTINGS) return;
  if (air_apart(found->place, told->place) > told->uncertainty_m) return;
  for (int i = 0; i < thing_count; i++)
    near += walks(&things[i]) && things[i].frames >= SIGHTINGS && air_apart(things[i].place, found->place) < no_mark_within_m;
  air_begin("reports");
  air_add(",\"id\":\"report-%s\",\"intelligence_id\":\"%s\",\"class_label\":\"%s\"", told->id, told->id, told->class_label);
  air_add(",\"east_m\":%.3f,\"north_m\":%.3f,\"confidence\":%.3f", found->place.east_m, found->place.north_m, found->confidence);
  air_add(",\"mark\":%s,\"bystanders_seen\":%d,\"reason\":\"%d people are near\"", near ? "false" : "true", near, near);
  air_end();
  told->is_reported = 1;
}

static void tell(void) {
  const char *comma = "";
  air_begin("status"), air_add(",\"phase\":\"%s\"", phase), air_end();
  air_begin("tracks");
  air_add(",\"tracks\":[");
  for (air_thing *held = things; held < things + thing_count; held++) {
    if (held->frames < SIGHTINGS || (walks(held) && air.now_s - held->seen_s >= FORGET_S)) continue;
    air_add("%s{\"id\":\"thing-%d\",\"class_label\":\"%s\",\"frames\":%d", comma, (int)(held - things), held->class_label, held->frames);
    air_add(",\"east_m\":%.3f,\"north_m\":%.3f,\"confidence\":%.3f}", held->place.east_m, held->place.north_m, held->confidence);
    comma = ",";
  }
  air_add("]");
  air_end();
}

static void fly(int again) {
  target *next = NULL;
  for (target *told = targets; told < targets + target_count; told++)
    if (!told->is_visited && (!next || told->priority < next->priority)) next = told;
  air_place goal = next ? next->place : home;
  if (!strcmp(phase, "landing")) {
    if (again) air_land();
    if (!air.is_armed) phase = "complete";
  } else if (!strcmp(phase, "starting") || !strcmp(phase, "taking_off")) {
    phase = air.height_m > 0.8 * altitude_m ? "transit" : air.is_armed ? "taking_off" : "starting";
    if (again && air.is_ready) air.is_armed ? air_take_off(altitude_m) : air_arm();
  } else if (strcmp(phase, "complete")) {
    phase = next ? "transit" : "returning";
    if (again) air_go_to(goal, altitude_m, speed_mps);
    if (air_apart(air_position(), goal) >= 5) return;
    arrived_s = arrived_s ? arrived_s : air.now_s; /* over the place for eight seconds, or down at home */
    if (!next) phase = "landing";
    if (next && air.now_s - arrived_s > 8) next->is_visited = 1, arrived_s = 0;
  }
}

int main(void) {
  static const char *const topics[] = {"mission", "intelligence", "orders", "detections", "/tf", "/tf_static", "camera/front/camera_info", NULL};
  for (air_open("tick-search", topics); air_tick(); air_ack()) {
    int again = air.now_s - asked_s >= 3, second = air.now_s - second_s >= 1;
    for (const json *item = air.messages; item; item = item->next) take_in(json_text(item, "topic"), json_get(item, "message"));
    if (second) air_heartbeat(), tell(), second_s = air.now_s;
    for (int i = 0; i < target_count * thing_count; i++) report(&targets[i / thing_count], &things[i % thing_count]);
    if (has_mission) fly(again);
    if (again) asked_s = air.now_s;
  }
}

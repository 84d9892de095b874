/* teletact-device-box VENDOR SETTINGS: the process that has a maker's library and the device. Started by
 * adapter.c, which shares a page with it (page.h). It outlives nobody: when the client is gone it gives no
 * force and ends. */
#define _GNU_SOURCE
#include "box.h"

#include <dlfcn.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "page.h"

static box_page* page;
static const box_vendor* vendor;
static _Atomic int stopping;             /* no force any more */
static _Atomic int64_t turned_ns;        /* the newest turn */
static _Atomic int64_t failing_since_ns; /* 0: the newest turn did not fail */
static _Atomic int64_t turns;
static _Atomic double largest_force_n; /* 0 until the device has stated it */

/* ---- said to people -------------------------------------------------------------------------------------
 */

/* One line, of any thread: the turns' and the main one's seldom meet, and then the newer stays. */
static void say(const char* what, const char* why) {
  const uint32_t next = page->said + 1;
  snprintf(page->trouble[next % 2], sizeof page->trouble[0], "%s%s%s", what, why[0] ? ": " : "", why);
  page->said = next;
}

/* The same kind not again within 5 s. */
static void say_seldom(int64_t* last_ns, const char* what, const char* why) {
  const int64_t now_ns = box_now_ns();
  if (*last_ns != 0 && now_ns - *last_ns < 5ll * BOX_NS_PER_S) return;
  *last_ns = now_ns;
  say(what, why);
}

/* ---- turns ------------------------------------------------------------------------------------------------
 */

void box_force(double force_n[3]) {
  const int lives =
      !stopping && !page->let_go && !page->closed && box_now_ns() - page->commanded_ns < BOX_FORCE_LIVES_NS;
  double squared = 0;
  for (int axis = 0; axis < 3; ++axis) {
    force_n[axis] = lives ? page->command_n[axis] : 0;
    squared += force_n[axis] * force_n[axis];
  }
  /* Whatever came, the device is asked for numbers, and for no more than it gives. */
  const double max_n = largest_force_n, size_n = sqrt(squared);
  const double share = !isfinite(size_n) ? 0 : size_n > max_n ? max_n / size_n : 1;
  for (int axis = 0; axis < 3; ++axis) force_n[axis] = share == 0 ? 0 : share * force_n[axis];
}

static void turn_ends(void) {
  static int64_t slow_said_ns;
  const int64_t now_ns = box_now_ns(), took_ns = now_ns - turned_ns;
  if (took_ns > BOX_SLOW_NS && turns > 0) {
    char text[96];
    snprintf(text, sizeof text, "the maker's library took %lld ms for a turn",
             (long long)(took_ns / 1000000));
    say_seldom(&slow_said_ns, text, "the force was held for as long");
  }
  turned_ns = now_ns;
  ++turns;
}

void box_moved(const double position_m[3], const double velocity_m_s[3], uint32_t buttons) {
  turn_ends();
  for (int axis = 0; axis < 3; ++axis) {
    page->position_m[axis] = position_m[axis];
    page->velocity_m_s[axis] = velocity_m_s[axis];
  }
  page->buttons = buttons;
  page->moved_ns = turned_ns;
  failing_since_ns = 0;
}

void box_failed(const char* what, const char* why) {
  static int64_t said_ns;
  turn_ends();
  ++page->failures;
  if (failing_since_ns == 0) failing_since_ns = turned_ns;
  say_seldom(&said_ns, what, why);
}

void box_waits(const char* why) {
  static int64_t said_ns;
  turn_ends();
  failing_since_ns = 0;
  say_seldom(&said_ns, "it has no position yet", why);
}

/* ---- the maker's library
 * ------------------------------------------------------------------------------------ */

const char* box_find(void* library, const box_function* functions) {
  for (; functions->name != NULL; ++functions) {
    *functions->at = dlsym(library, functions->name);
    if (*functions->at == NULL) return functions->name;
  }
  return NULL;
}

/* False, with the reason, when they are not understood. */
static int read_settings(const char* text, box_settings* settings, char* error) {
  char copy[512], *rest = copy, *word;
  memset(settings, 0, sizeof *settings);
  const int whole = snprintf(copy, sizeof copy, "%s", text) < (int)sizeof copy;
  while (whole && (word = strsep(&rest, ",")) != NULL) {
    char* value = strchr(word, '=');
    if (word[0] == '\0' && text[0] == '\0') return 1;
    char* at = NULL;
    size_t bytes = 0;
    if (strncmp(word, "library=", 8) == 0) at = settings->library, bytes = sizeof settings->library;
    if (vendor->takes_device_name && strncmp(word, "device=", 7) == 0)
      at = settings->device, bytes = sizeof settings->device;
    if (at == NULL || value[1] == '\0' || snprintf(at, bytes, "%s", value + 1) >= (int)bytes) break;
    if (rest == NULL) return 1;
  }
  snprintf(error, BOX_ERROR_BYTES, "settings '%.200s': give library=PATH of %s%s, or nothing", text,
           vendor->product,
           vendor->takes_device_name ? ", device=NAME as its set-up tool names it, or both" : "");
  return 0;
}

static int load(const box_settings* settings, char* error) {
  void* library = NULL;
  const char* used = settings->library;
  if (used[0] != '\0') library = dlopen(used, RTLD_NOW | RTLD_LOCAL);
  for (const char* const* file = vendor->files; used[0] == '\0' && library == NULL && *file != NULL; ++file) {
    library = dlopen(*file, RTLD_NOW | RTLD_LOCAL);
    if (library != NULL) used = *file;
  }
  if (library == NULL) {
    snprintf(error, BOX_ERROR_BYTES,
             "%.180s cannot be loaded (%.120s): install %s, or say where it lies with library=PATH",
             used[0] ? used : vendor->files[0], dlerror(), vendor->product);
    return 0;
  }
  const char* missing = vendor->find(library);
  if (missing == NULL) return 1;
  snprintf(error, BOX_ERROR_BYTES,
           "%.160s has no function %s: it is not %s, or another version; give another with library=PATH",
           used, missing, vendor->product);
  return 0;
}

/* ---- the life of the process
 * ---------------------------------------------------------------------------------- */

static void pause_ms(long ms) {
  const struct timespec pause = {0, ms * 1000000};
  nanosleep(&pause, NULL);
}

static int client_is_done(void) {
  return page->closed || getppid() != page->client;
}

static int open_device(const box_settings* settings, char* error) {
  teletact_device_limits limits;
  char name[sizeof page->name];
  memset(&limits, 0, sizeof limits);
  failing_since_ns = turns = stopping = 0;
  turned_ns = box_now_ns();
  /* The first turns come while this is filled in: no force, as none is commanded before a reading. */
  if (vendor->open(settings, name, sizeof name, &limits, error) != 0) return 0;
  if (page->state != BOX_OPEN) {
    page->limits = limits;
    memcpy(page->name, name, sizeof name);
  }
  turned_ns = box_now_ns();
  largest_force_n = limits.largest_force_n;
  page->state = BOX_OPEN;
  return 1;
}

/* False when the client is done before. */
static int open_again(const box_settings* settings) {
  char error[BOX_ERROR_BYTES] = "";
  int64_t said_ns = 0;
  while (!client_is_done()) {
    if (open_device(settings, error)) {
      say("it answers again", "lift the finger and resume");
      return 1;
    }
    say_seldom(&said_ns, "it cannot be opened again", error);
    for (int n = 0; n < 50 && !client_is_done(); ++n) pause_ms(10);
  }
  return 0;
}

/* Returns when the client is done, or the device has failed for too long. */
static void watch_turns(void) {
  while (!client_is_done()) {
    const int64_t now_ns = box_now_ns(), failing_ns = failing_since_ns;
    if (failing_ns != 0 && now_ns - failing_ns > BOX_FAILS_NS) return;
    if (now_ns - turned_ns > BOX_HANGS_NS) {
      stopping = 1;
      say("the maker's library does not return from a call, and its process was ended",
          "see to the device, and start again");
      _exit(3); /* nothing else can reach the device */
    }
    pause_ms(1);
  }
}

/* Two more turns, without a force; not of a device that has none any more. */
static void let_go(void) {
  stopping = 1;
  const int64_t from = turns, until_ns = box_now_ns() + 50000000;
  while (turns < from + 2 && box_now_ns() < until_ns) pause_ms(1);
}

static int refuse(const char* error) {
  snprintf(page->error, sizeof page->error, "%s", error);
  page->state = BOX_REFUSED;
  return 1;
}

int main(int count, char** words) {
  char error[BOX_ERROR_BYTES] = "";
  box_settings settings;
  if (count != 3) {
    fprintf(stderr,
            "teletact-device-box is started by a device plugin of teletact: touch --device plugin:FILE\n");
    return 2;
  }
  page = mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, BOX_PAGE_DESCRIPTOR, 0);
  if (page == MAP_FAILED) return 2;
  signal(SIGPIPE, SIG_IGN);
  const box_vendor* const vendors[] = {&box_force_dimension, &box_openhaptics};
  for (size_t k = 0; k < sizeof vendors / sizeof *vendors; ++k)
    if (strcmp(words[1], vendors[k]->name) == 0) vendor = vendors[k];
  if (vendor == NULL) return refuse("the box beside this plugin does not know its maker: install both again");
  if (!read_settings(words[2], &settings, error) || !load(&settings, error) || !open_device(&settings, error))
    return refuse(error);
  do {
    watch_turns();
    let_go();
    vendor->close();
  } while (open_again(&settings));
  return 0;
}

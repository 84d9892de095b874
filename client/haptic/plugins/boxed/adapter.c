/* An adapter whose maker's library runs in a process of its own, teletact-device-box, which lies beside this
 * one. It is compiled once for each VENDOR that the box knows; it knows none itself.
 *
 * So read() and write() never wait, a library that hangs or crashes takes nobody with it, and when the client
 * is gone, or writes no force for 10 ms, the box gives none. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include "page.h"

#define OPEN_PATIENCE_NS (20ll * BOX_NS_PER_S) /* some devices calibrate first */
#define CLOSE_PATIENCE_NS (2ll * BOX_NS_PER_S)

extern char** environ;

typedef struct adapter {
  box_page* page;
  pid_t box;
  int64_t failures; /* as read() saw them last */
  uint32_t said;    /* as trouble() did */
} adapter;

static teletact_device_plugin plugin;
static char plugin_name[sizeof((box_page*)0)->name] = VENDOR;

static void pause_ms(long ms) {
  const struct timespec pause = {0, ms * 1000000};
  nanosleep(&pause, NULL);
}

/* Where the box lies: beside this library. */
static int find_box(char* path, size_t bytes) {
  Dl_info own;
  if (dladdr((void*)&plugin, &own) == 0 || own.dli_fname == NULL) return 0;
  const char* slash = strrchr(own.dli_fname, '/');
  const int folder = slash == NULL ? 0 : (int)(slash - own.dli_fname) + 1;
  return snprintf(path, bytes, "%.*steletact-device-box", folder, own.dli_fname) < (int)bytes;
}

/* Its own session, so that the terminal's signals are the client's, and none of the client's files. */
static int spawn_box(const char* path, const char* settings, int descriptor, pid_t* box) {
  posix_spawn_file_actions_t files;
  posix_spawnattr_t attributes;
  sigset_t none;
  sigemptyset(&none);
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_adddup2(&files, descriptor, BOX_PAGE_DESCRIPTOR);
  posix_spawn_file_actions_addclosefrom_np(&files, BOX_PAGE_DESCRIPTOR + 1);
  posix_spawnattr_init(&attributes);
  posix_spawnattr_setsigmask(&attributes, &none);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETSID | POSIX_SPAWN_SETSIGMASK);
  char* const words[] = {(char*)path, (char*)VENDOR, (char*)settings, NULL};
  const int failed = posix_spawn(box, path, &files, &attributes, words, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
  return failed == 0;
}

/* Waits for the box's end, and ends it when that does not come. */
static void end_box(adapter* opened) {
  opened->page->closed = 1;
  const int64_t until_ns = box_now_ns() + CLOSE_PATIENCE_NS;
  while (opened->box > 0 && waitpid(opened->box, NULL, WNOHANG) == 0) {
    if (box_now_ns() > until_ns) {
      kill(opened->box, SIGKILL);
      waitpid(opened->box, NULL, 0);
      break;
    }
    pause_ms(1);
  }
  munmap(opened->page, sizeof *opened->page);
  free(opened);
}

/* 0 once it has opened its device; else the reason is in `error`. */
static int await_box(adapter* opened, char* error, size_t error_bytes) {
  const int64_t until_ns = box_now_ns() + OPEN_PATIENCE_NS;
  while (opened->page->state == BOX_OPENING && box_now_ns() < until_ns) {
    if (waitpid(opened->box, NULL, WNOHANG) == opened->box) {
      opened->box = 0;
      if (opened->page->state != BOX_OPENING) break;
      snprintf(
          error, error_bytes,
          "the process with the maker's library ended while it opened the device: that library crashed, or "
          "teletact-device-box cannot run here");
      return 1;
    }
    pause_ms(2);
  }
  if (opened->page->state == BOX_OPEN) return 0;
  if (opened->page->state == BOX_REFUSED)
    snprintf(error, error_bytes, "%s", opened->page->error);
  else
    snprintf(error, error_bytes,
             "the maker's library has not opened the device in %lld s: see to its cable and power",
             OPEN_PATIENCE_NS / BOX_NS_PER_S);
  return 1;
}

static int adapter_open(const char* settings, void** device, teletact_device_limits* limits, char* error,
                        size_t error_bytes) {
  char path[4096];
  adapter* opened = calloc(1, sizeof *opened);
  const int descriptor = memfd_create("teletact-device", MFD_CLOEXEC);
  box_page* page = MAP_FAILED;
  if (descriptor >= 0 && ftruncate(descriptor, sizeof *page) == 0)
    page = mmap(NULL, sizeof *page, PROT_READ | PROT_WRITE, MAP_SHARED, descriptor, 0);
  if (opened == NULL || page == MAP_FAILED) {
    snprintf(error, error_bytes, "no memory to share with the device's process");
    if (page != MAP_FAILED) munmap(page, sizeof *page);
    if (descriptor >= 0) close(descriptor);
    free(opened);
    return 1;
  }
  opened->page = page;
  page->client = getpid();
  const int there = find_box(path, sizeof path) && access(path, X_OK) == 0;
  const int runs = there && spawn_box(path, settings, descriptor, &opened->box);
  close(descriptor);
  if (!runs) snprintf(error, error_bytes, "cannot start %s: it has to lie beside the plugin's file", path);
  if (!runs || await_box(opened, error, error_bytes) != 0) {
    end_box(opened);
    return 1;
  }
  *limits = page->limits;
  snprintf(plugin_name, sizeof plugin_name, "%s", page->name);
  *device = opened;
  return 0;
}

static int adapter_read(void* device, int64_t now_ns, teletact_device_reading* reading) {
  (void)now_ns; /* whatever clock the servo runs on */
  adapter* opened = device;
  const box_page* page = opened->page;
  for (int axis = 0; axis < 3; ++axis) {
    reading->position_m[axis] = page->position_m[axis];
    reading->velocity_m_s[axis] = page->velocity_m_s[axis];
  }
  reading->buttons = page->buttons;
  reading->resume_pressed = (reading->buttons & 1u) != 0;
  const int64_t failures = page->failures;
  const int failed = failures != opened->failures;
  opened->failures = failures;
  return failed || box_now_ns() - page->moved_ns > BOX_IS_LOST_NS;
}

static int adapter_write(void* device, const double force_n[3]) {
  box_page* page = ((adapter*)device)->page;
  for (int axis = 0; axis < 3; ++axis) page->command_n[axis] = force_n[axis];
  page->commanded_ns = box_now_ns();
  return 0;
}

static size_t adapter_trouble(void* device, char* text, size_t text_bytes) {
  adapter* opened = device;
  const uint32_t said = opened->page->said;
  if (said == opened->said) return 0;
  opened->said = said;
  snprintf(text, text_bytes, "%.*s", (int)sizeof opened->page->trouble[0] - 1,
           opened->page->trouble[said % 2]);
  return strlen(text);
}

static void adapter_let_go(void* device) {
  ++((adapter*)device)->page->let_go;
}

static void adapter_close(void* device) {
  end_box(device);
}

static teletact_device_plugin plugin = {
    .abi = TELETACT_DEVICE_ABI,
    .struct_bytes = sizeof(teletact_device_plugin),
    .name = plugin_name,
    .open = adapter_open,
    .read = adapter_read,
    .write = adapter_write,
    .close = adapter_close,
    .let_go = adapter_let_go,
    .show_taxels = NULL,
    .trouble = adapter_trouble,
};

const teletact_device_plugin* teletact_device_plugin_get(void) {
  return &plugin;
}

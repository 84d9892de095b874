// Memory is locked for the loop's sake: never so that another thread's allocation fails for it.
#include "client/servo/realtime.h"

#include <gtest/gtest.h>
#include <linux/capability.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>

namespace teletact::client {
namespace {

constexpr std::size_t kMiB = 1 << 20;

std::size_t kib_of_status(const std::string& field) {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind(field, 0) == 0) return std::strtoul(line.c_str() + field.size(), nullptr, 10);
  return 0;
}

// What a child finds, as its exit status; 0: as it should be.
template <typename Function>
int in_a_child(const Function& body) {
  const pid_t child = fork();
  if (child == 0) {
    int found = -1;
    std::thread([&] { found = body(); }).join();
    _exit(found);
  }
  int status = -1;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 100 + status;
}

// To `bytes`, or what may be asked for here.
bool limit_locked_memory(std::size_t bytes) {
  __user_cap_header_struct header{_LINUX_CAPABILITY_VERSION_3, 0};
  std::array<__user_cap_data_struct, _LINUX_CAPABILITY_U32S_3> data{};
  if (syscall(SYS_capget, &header, data.data()) != 0) return false;
  data[CAP_TO_INDEX(CAP_IPC_LOCK)].effective &= ~CAP_TO_MASK(CAP_IPC_LOCK);
  rlimit limit{};
  getrlimit(RLIMIT_MEMLOCK, &limit);
  limit.rlim_cur = limit.rlim_max = std::min<rlim_t>(bytes, limit.rlim_max);
  return setrlimit(RLIMIT_MEMLOCK, &limit) == 0 && syscall(SYS_capset, &header, data.data()) == 0;
}

TEST(RealTime, ALimitOfLockedMemoryFailsNoAllocation) {
  // A limit that all of the process fits in, so that locking the whole of it would be granted; and a usual
  // one.
  for (const std::size_t spare : {8 * kMiB, std::size_t{0}})
    EXPECT_EQ(in_a_child([spare] {
                const std::size_t all = 1024 * kib_of_status("VmSize:");
                if (!limit_locked_memory(spare == 0 ? 8 * kMiB : all + spare)) return 1;
                static std::array<char, 2 * kMiB> loop;
                const RealTime granted = ask_for_real_time(loop.data(), loop.size());
                if (!granted.locked || kib_of_status("VmLck:") < 2 * 1024) return 2;
                if (granted.text.find("loop's memory locked") == std::string::npos) return 3;
                for (int n = 0; n < 16; ++n) {
                  auto* const memory = static_cast<volatile char*>(std::malloc(16 * kMiB));
                  if (memory == nullptr) return 4;
                  for (std::size_t at = 0; at < 16 * kMiB; at += 4096) memory[at] = 1;
                }
                return 0;
              }),
              0)
        << spare;
}

TEST(RealTime, GivenALimitThatIsTooSmallThenItSaysSoAndGoesOn) {
  EXPECT_EQ(in_a_child([] {
              if (!limit_locked_memory(4096)) return 1;
              static std::array<char, 2 * kMiB> loop;
              const RealTime granted = ask_for_real_time(loop.data(), loop.size());
              return !granted.locked && granted.text.find("ulimit -l unlimited") != std::string::npos ? 0 : 2;
            }),
            0);
}

}  // namespace
}  // namespace teletact::client

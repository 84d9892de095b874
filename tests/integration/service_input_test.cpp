// Bad input to the service, and its life: one clear line, a non-zero exit, signals obeyed.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <memory>

#include "tests/integration/one_clear_line.h"
#include "tests/integration/process.h"

namespace teletact {
namespace {

using test::Environment;
using test::expect_one_clear_line;
using test::Outcome;
using test::TemporaryFolder;

void write(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

TEST(ServiceInput, NoOpenClDeviceAndAnUnwritableKernelCacheAreSaid) {
  TemporaryFolder folder;
  const std::vector<std::string> serve{test::service_binary(), "serve", "--listen", "unix:" + (folder / "s")};
  expect_one_clear_line(test::run(serve, folder / "log", {{"OCL_ICD_VENDORS", "/nonexistent"}}),
                        {"OpenCL device"});
  write(folder / "file", "not a folder");
  expect_one_clear_line(test::run(serve, folder / "log", {{"POCL_CACHE_DIR", folder / "file/cache"}}),
                        {"POCL_CACHE_DIR"});
}

// The environment is judged before PoCL sees it: PoCL would abort.
TEST(ServiceInput, HomesWithoutRoomForTheKernelCacheAreSaid) {
  TemporaryFolder folder;
  write(folder / "file", "not a folder");
  const std::vector<std::string> bare{"/usr/bin/env", "-u", "POCL_CACHE_DIR", "-u", "XDG_CACHE_HOME"};
  const auto devices = [&](const std::vector<std::string>& settings) {
    std::vector<std::string> command = bare;
    command.insert(command.end(), settings.begin(), settings.end());
    command.insert(command.end(), {test::service_binary(), "devices"});
    return test::run(command, folder / "log");
  };
  expect_one_clear_line(devices({"HOME=" + (folder / "file")}), {"POCL_CACHE_DIR", folder / "file"});
  expect_one_clear_line(devices({"XDG_CACHE_HOME=" + (folder / "file/x")}), {"POCL_CACHE_DIR", "file/x"});
  expect_one_clear_line(devices({"POCL_CACHE_DIR="}), {"POCL_CACHE_DIR", "empty"});
}

TEST(ServiceInput, AStateFolderThatCannotBeWrittenOrIsTakenIsSaid) {
  TemporaryFolder folder;
  write(folder / "file", "not a folder");
  const std::vector<std::string> serve{test::service_binary(),   "serve",   "--listen",
                                       "unix:" + (folder / "s"), "--state", folder / "file/state"};
  expect_one_clear_line(test::run(serve, folder / "log", {}, 300), {"--state", folder / "file/state"});
}

TEST(ServiceInput, ABusySocketPortOrStateIsSaidAndItsOwnerServesOn) {
  TemporaryFolder folder;
  const auto serve = [&](const std::string& listen, const std::string& state) {
    return std::vector<std::string>{test::service_binary(), "serve", "--listen", listen, "--state", state};
  };
  const std::string socket = "unix:" + (folder / "s");
  test::Process owner(serve(socket, folder / "state"), folder / "owner.log");
  ASSERT_TRUE(owner.says("serving on", 300)) << owner.output();
  expect_one_clear_line(test::run(serve(socket, folder / "other"), folder / "log", {}, 300),
                        {folder / "s", "in use"});
  EXPECT_TRUE(std::filesystem::exists(folder / "s")) << "the second server took the first one's socket away";
  expect_one_clear_line(test::run(serve("unix:" + (folder / "t"), folder / "state"), folder / "log", {}, 300),
                        {"--state", "in use"});
  EXPECT_TRUE(owner.running());

  test::Process other(serve("127.0.0.1:0", folder / "other"), folder / "other.log");
  ASSERT_TRUE(other.says("serving on", 300)) << other.output();
  const std::string said = other.output();
  const std::size_t at = said.find("127.0.0.1:");
  const std::string port = said.substr(at, said.find(',', at) - at);
  expect_one_clear_line(test::run(serve(port, folder / "third"), folder / "log", {}, 300), {port, "in use"});
  EXPECT_TRUE(other.running());
}

TEST(ServiceLife, ASignalWhileItStartsEndsItAtOnce) {
  TemporaryFolder folder;
  std::filesystem::create_directory(folder / "cache");
  test::Process service({test::service_binary(), "serve", "--listen", "unix:" + (folder / "s")},
                        folder / "log",
                        {{"POCL_CACHE_DIR", folder / "cache"}, {"XDG_CACHE_HOME", folder / "xdg"}});
  // It compiles its kernels, for seconds.
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!std::filesystem::exists(folder / "s") && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  const auto told = std::chrono::steady_clock::now();
  service.kill(SIGTERM);
  EXPECT_EQ(service.wait(60), 0) << service.output();
  EXPECT_LT(std::chrono::steady_clock::now() - told, std::chrono::seconds(1));
  EXPECT_EQ(service.output().find("serving on"), std::string::npos) << "too quick a start to test anything";
}

TEST(ServiceLife, ASignalWhileItServesDrainsIt) {
  TemporaryFolder folder;
  test::Process service({test::service_binary(), "serve", "--listen", "unix:" + (folder / "s")},
                        folder / "log");
  ASSERT_TRUE(service.says("serving on", 300)) << service.output();
  service.kill(SIGINT);
  EXPECT_EQ(service.wait(20), 0) << service.output();
  EXPECT_NE(service.output().find("event=drained"), std::string::npos) << service.output();
}

}  // namespace
}  // namespace teletact

// ./teletact where others have been before: a build folder of somebody else's, an output folder in use.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/file.h>
#include <unistd.h>

#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include "tests/files/temporary_folder.h"
#include "tests/support/environment.h"

namespace teletact::client {
namespace {

namespace fs = std::filesystem;

class Script : public testing::Test {
 protected:
  void SetUp() override {
    const fs::path source = teletact::test::required_environment("TELETACT_SOURCE_DIR");
    fs::create_directories(folder_ / "demo");
    fs::copy_file(source / "teletact", folder_ / "teletact");
    fs::copy_file(source / "demo/demo.bash", folder_ / "demo/demo.bash");
  }
  // What it prints, and its status in the end.
  std::string run(const std::string& words, bool as_nobody = false) const {
    const std::string other =
        as_nobody && ::getuid() == 0 ? "setpriv --reuid=65534 --regid=65534 --clear-groups " : "";
    const std::unique_ptr<FILE, int (*)(FILE*)> out(
        ::popen(("env -u TELETACT_BUILD_DIR " + other + "bash " + (folder_ / "teletact").string() + " " +
                 words + " 2>&1; echo status $?")
                    .c_str(),
                "r"),
        ::pclose);
    std::string all;
    for (std::array<char, 256> line{}; std::fgets(line.data(), line.size(), out.get()) != nullptr;)
      all += line.data();
    return all;
  }
  const TemporaryFolder folder_;
};

TEST_F(Script, RunsWhatIsBuiltWhereItMayNotBuild) {
  const fs::path build = folder_ / "build/release";
  fs::create_directories(build / "client");
  put_content(build / "build.ninja", "");
  const fs::path client = build / "client/teletact-client";
  put_content(client, "#!/bin/sh\necho ran \"$@\"\n");
  fs::permissions(client, fs::perms(0755));
  fs::permissions(build, fs::perms(0555));
  const std::string built = run("scenes --service x", true);
  EXPECT_NE(built.find("running what is built there (TELETACT_BUILD_DIR"), std::string::npos) << built;
  EXPECT_NE(built.find("ran scenes --service x\nstatus 0"), std::string::npos) << built;
  const std::string not_built = run("serve", true);
  EXPECT_NE(not_built.find("is not built there: give a folder of your own in TELETACT_BUILD_DIR\nstatus 1"),
            std::string::npos)
      << not_built;
  fs::permissions(build, fs::perms(0755));
}

TEST_F(Script, SecondDemoInOneFolderIsRefusedAtOnce) {
  fs::create_directories(folder_ / "out/log");
  const int held = ::open((folder_ / "out/log").c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(::flock(held, LOCK_EX | LOCK_NB), 0);
  put_content(folder_ / "out/patient.toml", "the first's");
  const std::string second = run("demo --out " + (folder_ / "out").string());
  ::close(held);
  EXPECT_NE(second.find("another demo writes into " + (folder_ / "out").string()), std::string::npos)
      << second;
  EXPECT_NE(second.find("status 1"), std::string::npos) << second;
  EXPECT_EQ(content_of(folder_ / "out/patient.toml"), "the first's");
}

}  // namespace
}  // namespace teletact::client

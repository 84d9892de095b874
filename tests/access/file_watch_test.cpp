#include "service/access/file_watch.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "tests/support/kept_log.h"

namespace teletact::service {
namespace {

TEST(FileWatch, SaysWhatIsWrongOnceAndAgainOnceItWasRight) {
  const test::KeptLog log;
  std::atomic<bool> wrong{true};
  const FileWatch watch(std::chrono::milliseconds(1), "spoon_not_read", [&] {
    if (wrong) throw std::runtime_error("it is bent");
  });
  const auto looks_again = [&] {
    for (const std::uint64_t seen = watch.looks(); watch.looks() < seen + 3;) std::this_thread::yield();
  };
  const auto said = [&](int times) { return log.has("event=spoon_not_read error=\"it is bent\"", times); };
  looks_again();
  EXPECT_TRUE(said(1));
  EXPECT_FALSE(said(2));
  wrong = false;
  looks_again();
  wrong = true;
  looks_again();
  EXPECT_TRUE(said(2));
  EXPECT_FALSE(said(3));
}

}  // namespace
}  // namespace teletact::service

// Pairs that are spoiled on purpose, one for each word.
#include "client/acquire/spoiled_source.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <memory>
#include <string>

namespace teletact::client {
namespace {

class Pairs : public FrameSource {
 public:
  std::size_t window_count() const override { return 5; }
  double window_width_m() const override { return 0.06; }
  double compression_m() const override { return 0.001; }
  std::size_t frames_left(std::size_t window) const override { return 7 + window; }
  FramePair take(std::size_t) override {
    FramePair pair{{}, "pre", "post"};
    pair.acquisition.mutable_probe_force()->set_force_n(2);
    return pair;
  }
};

class SpoiledSourceTest : public ::testing::Test {
 protected:
  SpoiledSourceTest() {
    ::unlink(path_.c_str());
    EXPECT_EQ(::mkfifo(path_.c_str(), 0600), 0);
    source = std::make_unique<SpoiledSource>(std::make_unique<Pairs>(), path_);
    pipe_ = ::open(path_.c_str(), O_WRONLY | O_CLOEXEC);
  }
  ~SpoiledSourceTest() override {
    ::close(pipe_);
    ::unlink(path_.c_str());
  }
  void say(const std::string& words) {
    ASSERT_EQ(::write(pipe_, words.data(), words.size()), static_cast<ssize_t>(words.size()));
  }
  // What the next pair is.
  void expect(double force_n, const char* post) {
    const FramePair pair = source->take(0);
    EXPECT_EQ(pair.acquisition.probe_force().force_n(), force_n);
    EXPECT_EQ(pair.pre, "pre");
    EXPECT_EQ(pair.post, post);
  }

  std::unique_ptr<SpoiledSource> source;

 private:
  const std::string path_ = "/tmp/teletact-spoil-" + std::to_string(::getpid());
  int pipe_ = -1;
};

TEST_F(SpoiledSourceTest, EachWordSpoilsOnePair) {
  expect(2, "post");
  say("force\n");
  expect(6, "post");
  expect(2, "post");
  say("decorrelated\nforce\nno such word\n");
  expect(2, "tsop");
  expect(6, "post");
  expect(2, "post");
}

TEST_F(SpoiledSourceTest, AWordThatIsCutShortWaitsForItsRest) {
  say("decorr");
  expect(2, "post");
  say("elated\n");
  expect(2, "tsop");
}

// Whoever says more than fits: the pipe waits, and this holds no more.
TEST_F(SpoiledSourceTest, WhatIsNoLineIsBounded) {
  for (int n = 0; n < 100; ++n) {
    say(std::string(200, 'x'));
    expect(2, "post");
  }
}

TEST_F(SpoiledSourceTest, TheRestIsTheSourcesOwn) {
  EXPECT_EQ(source->window_count(), 5u);
  EXPECT_EQ(source->window_width_m(), 0.06);
  EXPECT_EQ(source->compression_m(), 0.001);
  EXPECT_EQ(source->frames_left(2), 9u);
}

TEST(SpoiledSource, APipeThatIsNotThereIsNamedWithTheRemedy) {
  try {
    SpoiledSource(std::make_unique<Pairs>(), "/tmp/no/such/pipe");
    FAIL() << "it was taken";
  } catch (const std::runtime_error& error) {
    EXPECT_EQ(std::string(error.what()),
              "--spoil /tmp/no/such/pipe: No such file or directory; make it by mkfifo");
  }
}

}  // namespace
}  // namespace teletact::client

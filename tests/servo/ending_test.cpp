#include "client/servo/ending.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <functional>
#include <memory>

namespace teletact::client {
namespace {

// What a process of its own, with one last act, told of it, and how it ended.
struct End {
  std::string acts;  // a letter each
  int status = 0;
};

int told = -1;  // where the acts go

End end_of(const std::function<void(const std::atomic<bool>& asked)>& life) {
  int ends[2];
  if (pipe(ends) != 0) throw std::runtime_error("pipe failed");
  const pid_t child = fork();
  if (child == 0) {
    told = ends[1];
    char letter = 'a';
    const LastAct act([](void* of) noexcept { (void)!write(told, of, 1); }, &letter);
    life(end_in_order());
    (void)!write(told, "z", 1);
    _exit(3);
  }
  close(ends[1]);
  End end;
  for (char letter; read(ends[0], &letter, 1) == 1;) end.acts += letter;
  close(ends[0]);
  waitpid(child, &end.status, 0);
  return end;
}

TEST(Ending, TheFirstAskIsAFlagAndTheSecondActsAndEnds) {
  for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
    const End once = end_of([&](const auto& asked) {
      if (asked) return;
      raise(signal);
      if (!asked) _exit(4);
    });
    EXPECT_EQ(once.acts, "z");
    EXPECT_TRUE(WIFEXITED(once.status) && WEXITSTATUS(once.status) == 3) << once.status;
    const End twice = end_of([&](const auto&) {
      raise(signal);
      raise(signal);
    });
    EXPECT_EQ(twice.acts, "aa");
    EXPECT_TRUE(WIFSIGNALED(twice.status) && WTERMSIG(twice.status) == signal) << twice.status;
  }
}

TEST(Ending, ACrashActsBeforeItEndsTheProcess) {
  const End terminated = end_of([](const auto&) { std::terminate(); });
  EXPECT_EQ(terminated.acts, "aa");
  EXPECT_TRUE(WIFSIGNALED(terminated.status) && WTERMSIG(terminated.status) == SIGABRT) << terminated.status;
  for (const int signal : {SIGQUIT, SIGUSR1, SIGXCPU, SIGALRM}) {
    const End sent = end_of([&](const auto&) { raise(signal); });
    EXPECT_EQ(sent.acts, "aa") << signal;
    EXPECT_TRUE(WIFSIGNALED(sent.status) && WTERMSIG(sent.status) == signal) << sent.status;
  }
}

TEST(Ending, NowActsAndEndsWithACodeWhateverSignalsCome) {
  const End end = end_of([](const auto&) {
    raise(SIGINT);
    end_now(7, "");
  });
  EXPECT_EQ(end.acts, "aa");
  EXPECT_TRUE(WIFEXITED(end.status) && WEXITSTATUS(end.status) == 7) << end.status;
}

TEST(Ending, WhatWouldStopOrEndForNothingIsIgnored) {
  const End end = end_of([](const auto& asked) {
    for (const int signal : {SIGPIPE, SIGXFSZ, SIGTSTP, SIGTTIN, SIGTTOU}) raise(signal);
    if (asked) _exit(4);
  });
  EXPECT_EQ(end.acts, "z");
  EXPECT_TRUE(WIFEXITED(end.status) && WEXITSTATUS(end.status) == 3) << end.status;
}

TEST(Ending, ActsComeAndGoWithTheirOwners) {
  const End end = end_of([](const auto&) {
    char b = 'b', c = 'c';
    const auto act = [](void* of) noexcept { (void)!write(told, of, 1); };
    auto gone = std::make_unique<LastAct>(act, &b);
    const LastAct stays(act, &c);
    gone.reset();
    raise(SIGQUIT);
  });
  EXPECT_EQ(end.acts, "acac");
}

}  // namespace
}  // namespace teletact::client

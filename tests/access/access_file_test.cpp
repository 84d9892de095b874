#include "service/access/access.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <thread>

#include "tests/access/access_folder.h"

namespace teletact::service {
namespace {

const WallClock::time_point kNow{std::chrono::hours(500'000)};  // 2027-01-15T08:00Z

class AccessFile : public testing::Test {
 protected:
  // Of a file that is not taken: one line with the file's name.
  std::string why(const std::string& text) {
    const auto file = folder.put("access.toml", text);
    try {
      read_access(file);
      return "";
    } catch (const std::runtime_error& error) {
      const std::string line = error.what();
      EXPECT_EQ(line.find('\n'), std::string::npos) << line;
      EXPECT_EQ(line.find("--access " + file.string()), 0U) << line;
      return line;
    }
  }
  void expect_why(const std::string& text, const std::vector<const char*>& words) {
    const std::string line = why(text);
    for (const char* word : words) EXPECT_NE(line.find(word), std::string::npos) << text << "\n" << line;
  }
  AccessFolder folder;
};

TEST_F(AccessFile, SaysWhoMayDoWhat) {
  const AccessTable table = read_access(
      folder.put("access.toml", entry_of("anna", "operator", "expires = 2027-01-15T10:00:00+02:00\n") +
                                    "[[entry]]\nname = \"probe\"\ncertificate = \"spiffe://clinic/probe\"\n"
                                    "roles = { liver = \"patient\" }\n"));
  EXPECT_EQ(table.size(), 2U);
  const Proof anna{.token = digest_of("anna-token")};
  EXPECT_EQ(table.known(anna, kNow - std::chrono::seconds(1)).name, "anna");
  EXPECT_THROW(table.known(anna, kNow), AccessRefused) << "10:00 at +02:00 is 08:00Z";
  const Principal& probe = table.known({.certificate_names = {"spiffe://clinic/probe"}}, kNow);
  EXPECT_TRUE(AccessTable::may(probe, {Need::kPublish, "liver"}));
  EXPECT_FALSE(AccessTable::may(probe, {Need::kPublish, "kidney"}));
}

TEST_F(AccessFile, WhatIsWrongIsSaidWithEntryKeyAndRemedy) {
  const std::string digest(64, 'a');
  const auto with = [&](const std::string& lines) { return "[[entry]]\nname = \"anna\"\n" + lines; };
  const std::string known = "token_sha256 = \"" + digest + "\"\n", roles = "roles = { s = \"observer\" }\n";
  EXPECT_EQ(why(with(known + roles)), "");
  expect_why("", {"no entry"});
  expect_why("entry = []", {"no entry"});
  expect_why("[[entries]]\n", {"entries", "unknown key"});
  expect_why("entry = [3]", {"entry 1", "table"});
  expect_why("[[entry]]\n" + known + roles, {"entry 1", "name", "missing"});
  expect_why("[[entry]]\nname = \"an na\"\n" + known + roles, {"entry 1", "name"});
  expect_why(with(roles), {"'anna'", "token_sha256", "give one"});
  expect_why(with(known), {"'anna'", "roles"});
  expect_why(with("token_sha256 = \"secret\"\n" + roles), {"'anna'", "token_sha256", "sha256sum"});
  expect_why(with("token_sha256 = 5\n" + roles), {"'anna'", "token_sha256", "string"});
  expect_why(with("certificate = \"\"\n" + roles), {"'anna'", "certificate"});
  expect_why(with(known + "roles = { s = \"surgeon\" }\n"), {"'anna'", "roles.s", "patient, operator"});
  expect_why(with(known + "roles = { \"a b\" = \"observer\" }\n"), {"'anna'", "roles.a b", "'*'"});
  expect_why(with(known + "roles = \"observer\"\n"), {"'anna'", "roles", "table"});
  expect_why(with(known + "roles = {}\n"), {"'anna'", "roles", "empty"});
  expect_why(with(known + roles + "expires = \"2027-01-01\"\n"), {"'anna'", "expires", "no quotes"});
  expect_why(with(known + roles + "expires = 2027-01-01T00:00:00\n"), {"'anna'", "expires", "offset"});
  expect_why(with(known + roles + "expires = 2027-01-01\n"), {"'anna'", "expires"});
  expect_why(with(known + roles + "role = \"x\"\n"), {"'anna'", "role", "one of name"});
  expect_why(with(known + roles) + with("certificate = \"c\"\n" + roles), {"'anna'", "name", "twice"});
  expect_why("[[entry]\n", {"line 1"});
  EXPECT_THROW(read_access(folder / "absent.toml"), std::runtime_error);
  EXPECT_EQ(why(with("token_sha256 = \"secret\"\n" + roles)).find("secret"), std::string::npos)
      << "what stands in its place may be the token";
}

// Waits for what comes by the thread that looks at the file.
template <class Done>
bool comes(Done&& done) {
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::minutes(1);
  while (!done()) {
    if (std::chrono::steady_clock::now() > give_up) return false;
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  return true;
}

constexpr std::chrono::milliseconds kLook{5};

// What is there by now is looked at: the first of the two may have begun before.
bool is_looked_at(const Access& access) {
  return comes([&, before = access.looks()] { return access.looks() >= before + 2; });
}

TEST_F(AccessFile, IsTakenOverAsItChanges) {
  const auto file = folder.put("access.toml", entry_of("anna", "operator"));
  const Access access(file, WallClock::now, kLook);
  const std::uint64_t first = access.version();
  EXPECT_EQ(access.table()->size(), 1U);
  folder.put("access.toml", entry_of("anna", "operator") + entry_of("ben", "patient"));
  ASSERT_TRUE(comes([&] { return access.version() != first; }));
  EXPECT_EQ(access.table()->size(), 2U);
}

TEST_F(AccessFile, OneThatIsWrongOrGoneChangesNothing) {
  const auto file = folder.put("access.toml", entry_of("anna", "operator"));
  const Access access(file, WallClock::now, kLook);
  const std::uint64_t first = access.version();
  folder.put("access.toml", "[[entry]]\n");
  ASSERT_TRUE(is_looked_at(access));
  std::filesystem::remove(file);
  ASSERT_TRUE(is_looked_at(access));
  EXPECT_EQ(access.version(), first);
  EXPECT_EQ(access.table()->known({.token = digest_of("anna-token")}, kNow).name, "anna");
  folder.put("access.toml", entry_of("ben", "patient"));
  ASSERT_TRUE(comes([&] { return access.version() != first; }));
  EXPECT_THROW(access.table()->known({.token = digest_of("anna-token")}, kNow), AccessRefused);
}

}  // namespace
}  // namespace teletact::service

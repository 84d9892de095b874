// The trial set of packaging/teletact-credentials, as the service reads it.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <iterator>

#include "service/access/access.h"
#include "service/access/certificates.h"
#include "tests/access/access_folder.h"
#include "tests/access/made_certificates.h"
#include "tests/support/environment.h"

namespace teletact::service {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

mode_t mode_of(const fs::path& path) {
  struct stat found {};
  EXPECT_EQ(::stat(path.c_str(), &found), 0) << path;
  return found.st_mode & 07777;
}

class TrialSet : public testing::Test {
 protected:
  static std::string script() {
    return test::required_environment("TELETACT_SOURCE_DIR") + "/packaging/teletact-credentials";
  }
  // One line; empty: it was made, for 30 days.
  std::string why_refused(const fs::path& out, const std::string& host) {
    const std::string said = folder / "said";
    const bool made = std::system(("'" + script() + "' --days 30 --out '" + out.string() + "' --host '" +
                                   host + "' >'" + said + "' 2>&1")
                                      .c_str()) == 0;
    const std::string text = text_of(said);
    if (made) return "";
    EXPECT_EQ(text.find('\n'), text.size() - 1) << text;
    return text;
  }
  AccessFolder folder;
  const fs::path set = folder / "set";
};

TEST_F(TrialSet, HasATokenAndACertificateOfEachRoleForItsOwnerAlone) {
  const auto before = std::chrono::time_point_cast<std::chrono::seconds>(WallClock::now());
  ASSERT_EQ(why_refused(set, "node7"), "");
  EXPECT_EQ(mode_of(set), 0700U);
  std::size_t files = 0;
  for (const auto& entry : fs::directory_iterator(set)) {
    EXPECT_EQ(mode_of(entry.path()), 0600U) << entry.path();
    ++files;
  }
  EXPECT_EQ(files, 2 + 2 + 4 * 3 + 1U);
  const AccessTable table = read_access(set / "access.toml");
  EXPECT_EQ(table.size(), 4U);
  const auto end = end_of(text_of(set / "ca.pem"));
  EXPECT_GE(end, before + std::chrono::hours(30 * 24));
  EXPECT_LE(end, WallClock::now() + std::chrono::hours(30 * 24));
  for (const char* name : {"patient", "operator", "observer", "administrator"}) {
    std::string token = text_of(set / (std::string(name) + ".token"));
    ASSERT_EQ(token.size(), 65U) << "256 bits";
    ASSERT_EQ(token.back(), '\n');
    token.pop_back();
    const Principal& known = table.known({.token = digest_of(token)}, end - std::chrono::seconds(1));
    EXPECT_EQ(known.name, name);
    EXPECT_EQ(known.roles, (std::map<std::string, Role>{{"*", *role_of(name)}}));
    EXPECT_THROW(table.known({.token = digest_of(token)}, end), AccessRefused);
    const std::string certificate = text_of(set / (std::string(name) + ".pem"));
    require_pair(certificate, text_of(set / (std::string(name) + "-key.pem")));
    EXPECT_EQ(end_of(certificate), end);
    EXPECT_THROW(require_pair(certificate, text_of(set / "server-key.pem")), std::runtime_error);
  }
  require_pair(text_of(set / "ca.pem"), text_of(set / "ca-key.pem"));
  require_pair(text_of(set / "server.pem"), text_of(set / "server-key.pem"));
  // Another machine's clock may be behind.
  EXPECT_EQ(
      std::system(("openssl verify -attime " +
                   std::to_string(WallClock::to_time_t(before - std::chrono::minutes(59))) + " -CAfile '" +
                   (set / "ca.pem").string() + "' '" + (set / "server.pem").string() + "' >/dev/null")
                      .c_str()),
      0);
}

TEST_F(TrialSet, NothingIsWrittenOver) {
  fs::create_directory(set);
  ::chmod(set.c_str(), 0755);
  EXPECT_EQ(why_refused(set, "localhost"), "") << "an empty folder will do";
  EXPECT_EQ(mode_of(set), 0700U);
  const std::string before = text_of(set / "operator.token");
  EXPECT_NE(why_refused(set, "localhost").find("--out"), std::string::npos);
  EXPECT_EQ(text_of(set / "operator.token"), before);
  EXPECT_NE(why_refused(folder / "no" / "such", "localhost").find("--out"), std::string::npos);
  EXPECT_NE(why_refused(folder.put("file", ""), "localhost").find("--out"), std::string::npos);
}

TEST_F(TrialSet, AFullDiskLeavesNothing) {
  const fs::path place = folder / "place";
  fs::create_directory(place);
  EXPECT_NE(std::system(("(ulimit -f 0; exec '" + script() + "' --out '" + (place / "set").string() +
                         "') >/dev/null 2>&1")
                            .c_str()),
            0);
  EXPECT_TRUE(fs::is_empty(place));
}

TEST_F(TrialSet, AHostThatIsNoneIsRefused) {
  for (const std::string& host : {std::string(), std::string("a b"), std::string("a,DNS:b"),
                                  std::string("a\nb"), std::string(65, 'a')}) {
    EXPECT_NE(why_refused(set, host).find("--host"), std::string::npos) << host;
    EXPECT_FALSE(fs::exists(set)) << host;
  }
  EXPECT_EQ(why_refused(folder / "v4", "10.0.0.7"), "");
  EXPECT_EQ(why_refused(folder / "v6", "fd00::7"), "");
}

TEST(Certificates, WhatIsNoneIsRefused) {
  const Identity made = make_authority("test");
  EXPECT_THROW(require_pair("", made.key), std::runtime_error);
  EXPECT_THROW(require_pair(made.certificate, ""), std::runtime_error);
  EXPECT_THROW(require_pair(made.key, made.certificate), std::runtime_error);
  EXPECT_THROW(require_pair(made.certificate, make_authority("test").key), std::runtime_error);
  EXPECT_THROW(end_of("-----BEGIN CERTIFICATE-----\nAAAA\n-----END CERTIFICATE-----\n"), std::runtime_error);
}

}  // namespace
}  // namespace teletact::service

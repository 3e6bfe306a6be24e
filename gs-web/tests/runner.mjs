// Runs tests, one after the other.

/** Runs the tests whose names match a regular expression, prints how each ends, calls `close`, and ends the process. */
export async function runTests(tests, names = "", close) {
  let failed = 0;
  for (const [name, test] of Object.entries(tests).filter(([name]) => new RegExp(names).test(name))) {
    const started = Date.now();
    try {
      await test();
      console.log(`ok ${name} (${((Date.now() - started) / 1000).toFixed(1)} s)`);
    } catch (error) {
      failed += 1;
      // A program that failed has printed why.
      console.log(`FAILED ${name}\n${error.stdout ?? ""}${error.stack}`);
    }
  }
  await close();
  console.log(failed === 0 ? "all tests passed" : `${failed} failed`);
  // Browsers of tests that failed are still open.
  process.exit(failed === 0 ? 0 : 1);
}

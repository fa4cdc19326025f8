// The head of a report as a picture. Arguments: report.html, the JPEG file, the browser's program.
// SPDX-License-Identifier: Apache-2.0
import { chromium } from 'playwright-core';
import { pathToFileURL } from 'node:url';
import path from 'node:path';

const [, , report, picture, executablePath] = process.argv;
const browser = await chromium.launch({ executablePath, args: ['--no-sandbox'] });
const page = await browser.newPage({ viewport: { width: 1280, height: 850 }, colorScheme: 'light' });
await page.goto(pathToFileURL(path.resolve(report)).href);
await page.screenshot({ path: picture, type: 'jpeg', quality: 80 });
await browser.close();

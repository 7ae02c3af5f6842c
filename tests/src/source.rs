//! Rust source without its comments, strings and tests, for checks of style.

use std::path::{Path, PathBuf};

/// All `.rs` files under `folder`, sorted.
pub fn rust_files(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut folders = vec![folder.to_path_buf()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

/// The code with comments and the insides of literals blanked out; lines stay where they are.
pub fn blank_comments_and_literals(source: &str) -> String {
    let chars: Vec<char> = source.chars().collect();
    let mut out = String::with_capacity(source.len());
    let mut i = 0;
    let blank = |out: &mut String, c: char| out.push(if c == '\n' { '\n' } else { ' ' });
    while i < chars.len() {
        let end = literal_end(&chars, i);
        if end > i {
            chars[i..end].iter().for_each(|&c| blank(&mut out, c));
            i = end;
        } else {
            out.push(chars[i]);
            i += 1;
        }
    }
    out
}

/// End of the comment or literal that starts at `i`, or `i` if none does.
fn literal_end(chars: &[char], i: usize) -> usize {
    let at = |k: usize| chars.get(k).copied().unwrap_or('\0');
    let until = |from: usize, end: &dyn Fn(usize) -> bool| {
        (from..chars.len()).find(|&k| end(k)).unwrap_or(chars.len())
    };
    match (at(i), at(i + 1)) {
        ('/', '/') => until(i, &|k| at(k) == '\n'),
        ('/', '*') => {
            let (mut depth, mut k) = (1, i + 2);
            while k < chars.len() && depth > 0 {
                match (at(k), at(k + 1)) {
                    ('/', '*') => (depth, k) = (depth + 1, k + 2),
                    ('*', '/') => (depth, k) = (depth - 1, k + 2),
                    _ => k += 1,
                }
            }
            k
        }
        ('r', '"' | '#') if !is_word(i.checked_sub(1).map_or(' ', at)) => {
            let hashes = (i + 1..chars.len()).take_while(|&k| at(k) == '#').count();
            if at(i + 1 + hashes) != '"' {
                return i; // a raw identifier
            }
            let closes = |k: usize| at(k) == '"' && (1..=hashes).all(|h| at(k + h) == '#');
            (until(i + 2 + hashes, &closes) + 1 + hashes).min(chars.len())
        }
        ('"', _) => {
            let mut k = i + 1;
            while k < chars.len() && at(k) != '"' {
                k += if at(k) == '\\' { 2 } else { 1 };
            }
            (k + 1).min(chars.len())
        }
        ('\'', '\\') => (until(i + 3, &|k| at(k) == '\'') + 1).min(chars.len()),
        ('\'', _) if at(i + 2) == '\'' => i + 3,
        _ => i, // a lifetime, or plain code
    }
}

/// Removes items under `#[cfg(test)]` from blanked code; lines stay where they are.
pub fn without_tests(blanked: &str) -> String {
    let mut out = String::with_capacity(blanked.len());
    let mut rest = blanked;
    while let Some(start) = rest.find("#[cfg(test)]") {
        out.push_str(&rest[..start]);
        let item = &rest[start..];
        // The item ends at its semicolon or at the brace that closes its first one.
        let mut depth = 0;
        let mut end = item.len();
        for (k, c) in item.char_indices() {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                _ => {}
            }
            if depth == 0 && matches!(c, ';' | '}') {
                end = k + 1;
                break;
            }
        }
        out.extend(item[..end].chars().filter(|&c| c == '\n'));
        rest = &item[end..];
    }
    out.push_str(rest);
    out
}

/// Whether `code` has `token` where no letter, digit or underscore goes before or after it.
pub fn has_token(code: &str, token: &str) -> bool {
    code.match_indices(token).any(|(start, _)| {
        let before = code[..start].chars().next_back().unwrap_or(' ');
        let after = code[start + token.len()..].chars().next().unwrap_or(' ');
        let opens = token.chars().next().is_some_and(is_word);
        let closes = token.chars().next_back().is_some_and(is_word);
        !(opens && is_word(before) || closes && is_word(after))
    })
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_said_is_not_code() {
        let source = "a // unsafe\n/* unsafe /* x */ unsafe */ b \"unsafe \\\" unsafe\" c 'u' '\\'' \
                      r#\"unsafe \" unsafe\"# fn f<'a>(x: &'a str) { unsafe_code }";
        let code = blank_comments_and_literals(source);
        assert!(!has_token(&code, "unsafe"), "{code}");
        assert!(code.contains("fn f<'a>(x: &'a str) { unsafe_code }"), "{code}");
        assert_eq!(code.lines().count(), source.lines().count());
    }

    #[test]
    fn tests_are_cut_out_and_what_follows_stays() {
        let code = "fn a() {}\n#[cfg(test)]\nmod tests {\n fn b() { {} }\n}\nfn c() {}\n\
                    #[cfg(test)]\nmod more;\nfn d() {}";
        let kept = without_tests(code);
        assert!(kept.contains("fn a") && kept.contains("fn c") && kept.contains("fn d"));
        assert!(!kept.contains("fn b") && !kept.contains("more"));
        assert_eq!(kept.lines().count(), code.lines().count());
    }

    #[test]
    fn tokens_are_whole_words() {
        assert!(has_token("x = println!(", "println!"));
        assert!(!has_token("eprintln!(", "println!"));
        assert!(has_token("use std::fs::File", "std::fs"));
        assert!(!has_token("my_std::fsx", "std::fs"));
    }
}

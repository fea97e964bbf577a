//! The attribute `#[test]` for a test program without the usual harness, which decides how many of its tests run at
//! once: `#[macro_use] extern crate skysink_trial;` in its root collects all functions with that attribute in
//! `crate::TRIALS`.

use proc_macro::{Delimiter, Group, TokenStream, TokenTree};

/// Adds the function to `crate::TRIALS`, a distributed slice of linkme, as
/// `crate::Trial { module, name, ignored, run }`; `#[ignore]` has to come after it.
#[proc_macro_attribute]
pub fn test(_arguments: TokenStream, function: TokenStream) -> TokenStream {
    let mut kept: Vec<TokenTree> = Vec::new();
    let mut is_ignored = false;
    let mut name = None;
    for token in function {
        match (&token, kept.last()) {
            (TokenTree::Group(group), Some(TokenTree::Punct(hash))) if hash.as_char() == '#' && is_ignore(group) => {
                kept.pop();
                is_ignored = true;
                continue;
            }
            (TokenTree::Ident(ident), Some(TokenTree::Ident(keyword))) if keyword.to_string() == "fn" => {
                name.get_or_insert_with(|| ident.to_string());
            }
            _ => {}
        }
        kept.push(token);
    }
    let name = name.expect("a function");
    let trial = format!(
        "const _: () = {{
            #[::linkme::distributed_slice(crate::TRIALS)]
            static TRIAL: crate::Trial = crate::Trial {{
                module: ::core::module_path!(),
                name: \"{name}\",
                is_ignored: {is_ignored},
                run: || crate::TrialEnd::from({name}()),
            }};
        }};"
    );
    kept.into_iter().chain(trial.parse::<TokenStream>().expect("an item")).collect()
}

/// Whether these are the brackets of `#[ignore]`.
fn is_ignore(group: &Group) -> bool {
    let first = group.stream().into_iter().next();
    group.delimiter() == Delimiter::Bracket && first.is_some_and(|token| token.to_string() == "ignore")
}

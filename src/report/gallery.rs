//! Small pictures with their captions.

use super::html::{Html, add, escape};

/// A small picture.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Picture {
    /// Addresses of images that are held by the addresses themselves (see [`thumbnail`](super::thumbnail)), shown
    /// beside each other.
    pub images: Vec<String>,
    /// What they show.
    pub title: String,
    /// Figures under the title; may be empty.
    pub note: String,
}

/// Pictures in rows, as many beside each other as there is room for.
pub fn gallery(pictures: &[Picture]) -> Html {
    let mut text = String::from("<div class=\"gallery\">\n");
    for Picture { images, title, note } in pictures {
        let title = escape(title);
        text.push_str("<figure>");
        text.push_str("<div class=\"pair\">");
        for address in images {
            add(&mut text, format_args!("<img src=\"{}\" alt=\"{title}\">", escape(address)));
        }
        add(
            &mut text,
            format_args!("</div><figcaption><b>{title}</b> {}</figcaption></figure>\n", escape(note)),
        );
    }
    text.push_str("</div>\n");
    Html::raw(text)
}
